"""Runs operators' commands, and answers each once it has taken effect."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from zengrid.errors import WireError
from zengrid_clock.admission import RequestRefused
from zengrid_clock.between_slots import CHANGES_LIMIT

if TYPE_CHECKING:
    from zengrid.bus.pending_query import PendingQuery
    from zengrid.wire.queries import ControlRequest
    from zengrid_clock.between_slots import BetweenSlots
    from zengrid_clock.pace import Pace

EFFECT_S = 3.0
"""Longest wait for a command to take effect before it is answered all the same: clients wait for 5 s."""


class PendingCommand(NamedTuple):
    """A command that takes effect at the end of the slot, and the operator who waits for it."""

    query: PendingQuery
    with_homes: bool
    """Whether the answer lists the homes."""
    answer_by: float
    """When to answer at the latest (monotonic clock). [s]"""


class OperatorCommands:
    """Pause, resume, step, speed, stop and status.

    Parameters
    ----------
    status:
        Writes the status that answers every command, with or without the homes.
    """

    def __init__(self, pace: Pace, between_slots: BetweenSlots, status: Callable[[bool], bytes]) -> None:
        self._pace = pace
        self._between_slots = between_slots
        self._status = status
        self._pending: list[PendingCommand] = []

    def run(self, request: ControlRequest, query: PendingQuery) -> bytes | None:
        """Run a command; return the answer, or None if it is answered when it takes effect."""
        if request.command == "speed" and request.speed is None:
            raise WireError("speed: needs a number: times faster than real time, 0 for as fast as answers come")
        if request.command == "stop":
            self._pace.end()
        elif request.command != "status":
            if self._between_slots.is_full:
                raise RequestRefused(
                    "unavailable", f"command = {request.command}: {CHANGES_LIMIT} changes wait for the slot to end"
                )
            if not self._between_slots.apply(lambda: self._set_pace(request)):
                # An operator who gets the answer to a pause finds the market paused, with its last slot journalled.
                self._pending.append(PendingCommand(query, request.homes, time.monotonic() + EFFECT_S))
                return None
        return self._status(request.homes)

    def _set_pace(self, request: ControlRequest) -> None:
        now = time.monotonic()
        if request.command == "pause":
            self._pace.pause()
        elif request.command == "resume":
            self._pace.start(now)
        elif request.command == "step":
            self._pace.step(request.slots, now)
        elif request.speed is not None:
            self._pace.set_speed(request.speed, now)

    def answer_overdue(self) -> None:
        """Answer operators whose command takes long to take effect, such as while an agent hangs."""
        if self._pending:
            self._answer(time.monotonic())

    def answer_all(self) -> None:
        """Answer all operators: their commands have taken effect."""
        if self._pending:
            self._answer(math.inf)

    def _answer(self, now: float) -> None:
        due = [pending for pending in self._pending if pending.answer_by <= now]
        self._pending = [pending for pending in self._pending if pending.answer_by > now]
        answers = {with_homes: self._status(with_homes) for with_homes in {pending.with_homes for pending in due}}
        for pending in due:
            pending.query.reply(answers[pending.with_homes])
