"""How an agent learns in a running market."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

from zengrid.learn.live_defaults import EXPLORE_SLOTS
from zengrid.learn.settings import FOLLOWER, LEADER, Learning
from zengrid.policy.file import Role

LEARNING: dict[Role, Learning] = {
    "grid": replace(LEADER, memory=24_000, every=4),
    "prosumer": replace(FOLLOWER, memory=24_000, every=4),
}
"""How agents learn unless told otherwise: every fourth slot, so that four of them leave a market most of two cores."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """How an agent learns in a running market; ``learning.every`` and ``updates`` count slots and updates."""

    learning: Learning
    slots: int = EXPLORE_SLOTS
    """Slots over which exploration and step size fall to their ends; learning never ends."""
    seed: int = 0

    @classmethod
    def of(cls, role: Role, **changes: Any) -> Self:
        """The defaults of a role; ``changes`` are fields of this class."""
        return cls(learning=LEARNING[role], **changes)
