"""One phase of a slot as a barrier: actions in, decision out. Pure: no network, no time of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Generic, Literal, NamedTuple, TypeVar

from zengrid.errors import WireError

RefusalCause = Literal[
    "duplicate", "foreign", "future", "late", "malformed", "out_of_range", "oversized", "unknown_agent", "wrong_run"
]
"""Why an action is refused."""

A = TypeVar("A")


class SlotPhase(NamedTuple):
    """One of the two phases of a slot."""

    day: int
    slot: int
    phase: Literal["price", "battery"]

    @property
    def order(self) -> tuple[int, int, int]:
        """Sorts phases by time."""
        return self.day, self.slot, 0 if self.phase == "price" else 1


class ActionRefused(Exception):  # noqa: N818 - an expected outcome, not a fault of the program
    """An action does not count, for one cause."""

    def __init__(self, cause: RefusalCause, phase: SlotPhase | None = None) -> None:
        super().__init__(cause)
        self.cause: RefusalCause = cause
        self.phase = phase
        """The phase that the action was meant for, where it could be read."""


class PhaseBarrier(Generic[A]):
    """Collects the first valid action of each expected agent.

    Parameters
    ----------
    phase:
        The phase it belongs to.
    expected:
        Agents whose action counts if it arrives in time.
    awaited:
        Those of them for which the market waits.
    """

    def __init__(self, phase: SlotPhase, expected: Iterable[str], awaited: Iterable[str]) -> None:
        self.phase = phase
        self.expected = frozenset(expected)
        self.awaited = frozenset(awaited)
        self.missing = set(self.awaited)
        """Agents for which the market still waits."""
        self.actions: dict[str, A] = {}

    @property
    def is_complete(self) -> bool:
        """Whether the market waits for nobody any more."""
        return not self.missing

    def offer(self, agent: str, read: Callable[[], tuple[SlotPhase, A]]) -> None:
        """Count an action.

        Parameters
        ----------
        agent:
            The sender.
        read:
            Decodes and checks the action. Called only if an action of this agent is still wanted, so a flood costs
            little. Raises ``ActionRefused`` or ``WireError``.

        Raises
        ------
        ActionRefused
            With the cause, if the action does not count.
        """
        if agent in self.actions:
            raise ActionRefused("duplicate")
        try:
            phase, action = read()
        except WireError:
            raise ActionRefused("malformed") from None
        if phase != self.phase:
            raise ActionRefused("late" if phase.order < self.phase.order else "future", phase)
        if agent not in self.expected:
            raise ActionRefused("foreign")
        self.actions[agent] = action
        self.missing.discard(agent)

    def drop(self, agent: str) -> bool:
        """Stop waiting for an agent that is gone; return whether the market was waiting for it."""
        if agent not in self.missing:
            return False
        self.missing.discard(agent)
        return True
