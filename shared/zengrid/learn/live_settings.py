"""How an agent learns in a running market."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from zengrid.learn.settings import Learning
from zengrid.policy.file import Role

LEARNING: dict[Role, Learning] = {
    "grid": Learning(gamma=0.999, soft_target=0.02, n_step=2, epsilon_until=0.8, every=4),
    "prosumer": Learning(
        own_model=True, batch=32, gamma=0.999, lr=3e-3, lr_end=3e-4, soft_target=0.05, epsilon_start=0.1, every=4
    ),
}  # fmt: skip
"""How agents learn unless told otherwise: every fourth slot, so that four of them leave a market most of two cores."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """How an agent learns in a running market; ``learning.every`` and ``updates`` count slots and updates."""

    learning: Learning
    slots: int = 12_000
    """Slots over which exploration and step size fall to their ends; learning never ends."""
    memory: int = 24_000
    """Slots it remembers: what others did long ago they no longer do."""
    average: float = 0.998
    """What the running average of the weights, by which it acts, keeps in each update. [-]"""
    seed: int = 0

    @classmethod
    def of(cls, role: Role, **changes: Any) -> Self:
        """The defaults of a role; ``changes`` are fields of this class."""
        return cls(learning=LEARNING[role], **changes)
