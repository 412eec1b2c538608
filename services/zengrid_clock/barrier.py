"""One phase of a slot as a barrier: actions in, decision out. Pure: no network, no time of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Generic, Literal, NamedTuple, TypeVar

from zengrid.errors import WireError

Cause = Literal[
    "duplicate", "foreign", "future", "late", "malformed", "out_of_range", "oversized", "unknown_agent", "wrong_run"
]
"""Why an action was refused."""

A = TypeVar("A")


class Moment(NamedTuple):
    """Which phase of which slot."""

    day: int
    slot: int
    phase: Literal["price", "battery"]

    @property
    def order(self) -> tuple[int, int, int]:
        """Sorts moments in the order in which they come."""
        return self.day, self.slot, 0 if self.phase == "price" else 1


class Refused(Exception):  # noqa: N818 - an outcome of judging, not a fault of the program
    """An action does not count; carries its cause."""

    def __init__(self, cause: Cause, moment: Moment | None = None) -> None:
        super().__init__(cause)
        self.cause: Cause = cause
        self.moment = moment


class Barrier(Generic[A]):
    """Collects the first valid action of each expected agent.

    Parameters
    ----------
    moment:
        The phase it belongs to.
    expected:
        Agents whose action counts if it comes in time.
    waited:
        Those of them for which the market waits.
    """

    def __init__(self, moment: Moment, expected: Iterable[str], waited: Iterable[str]) -> None:
        self.moment = moment
        self.expected = frozenset(expected)
        self.waited = frozenset(waited)
        self.waiting = set(self.waited)
        self.answers: dict[str, A] = {}

    @property
    def done(self) -> bool:
        """Whether nobody is waited for any more."""
        return not self.waiting

    def offer(self, agent: str, read: Callable[[], tuple[Moment, A]]) -> None:
        """Count an action, or raise ``Refused`` with its cause.

        Parameters
        ----------
        agent:
            Who sent it.
        read:
            Decodes and checks it; called only where the answer is still wanted, so that a flood costs little. Raises
            ``Refused`` or ``WireError``.
        """
        if agent in self.answers:
            raise Refused("duplicate")
        try:
            moment, action = read()
        except WireError:
            raise Refused("malformed") from None
        if moment != self.moment:
            raise Refused("late" if moment.order < self.moment.order else "future", moment)
        if agent not in self.expected:
            raise Refused("foreign")
        self.answers[agent] = action
        self.waiting.discard(agent)

    def give_up(self, agent: str) -> bool:
        """Stop waiting for an agent that is gone; tells whether it was waited for."""
        if agent not in self.waiting:
            return False
        self.waiting.discard(agent)
        return True
