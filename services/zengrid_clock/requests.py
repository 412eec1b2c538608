"""Answers requests to join and leave and operators' commands; refuses and counts what is not permitted."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from zengrid.errors import JournalError, ZengridError
from zengrid.rate_limit import RateLimit
from zengrid.wire.codec import decode, encode
from zengrid.wire.queries import (
    ControlRequest,
    JoinReply,
    JoinRequest,
    LeaveReply,
    LeaveRequest,
    RefusalReason,
)
from zengrid_clock.admission import RequestRefused

if TYPE_CHECKING:
    from zengrid.bus.clock_link import BusEvent
    from zengrid_clock.admission import Admission
    from zengrid_clock.agent_registry import MarketAgent
    from zengrid_clock.event_log import EventLog
    from zengrid_clock.operator_commands import OperatorCommands

JOINS_PER_S, JOINS_BURST_S = 1.0, 10.0
"""How often one agent may join or leave in the long run, and how many seconds' worth at once. [1/s], [s]"""


class RequestHandler:
    """Decodes a request, has it carried out, and replies.

    Parameters
    ----------
    commands:
        Runs operators' commands.
    join_reply:
        Writes the reply to an agent that has joined.
    next_slot:
        Day and slot from which changes count.
    is_ended:
        Whether the market is over.
    refused:
        Counts refusals by cause.
    """

    def __init__(
        self,
        admission: Admission,
        commands: OperatorCommands,
        join_reply: Callable[[MarketAgent], JoinReply],
        next_slot: Callable[[], tuple[int, int]],
        is_ended: Callable[[], bool],
        refused: Counter[str],
        event_log: EventLog,
    ) -> None:
        self._admission = admission
        self._commands = commands
        self._join_reply = join_reply
        self._next_slot = next_slot
        self._is_ended = is_ended
        self._refused = refused
        self._event_log = event_log
        self._rate = RateLimit(JOINS_PER_S, JOINS_BURST_S)

    def answer(self, event: BusEvent) -> None:
        """Answer one request, whatever is wrong with it."""
        assert event.query is not None
        try:
            answer = self._answer(event)
            if answer is not None:
                event.query.reply(answer)
        except RequestRefused as refusal:
            self._refuse(event, refusal.reason, str(refusal))
        except JournalError:
            raise
        except ZengridError as error:
            self._refuse(event, "invalid", str(error))

    def refuse_failed(self, event: BusEvent, error: Exception) -> None:
        """Tell the sender that the clock failed to answer."""
        if event.query is not None and not event.query.is_closed:
            self._refuse(event, "unavailable", f"the clock could not answer: {type(error).__name__}")

    def _refuse(self, event: BusEvent, reason: RefusalReason, message: str) -> None:
        assert event.query is not None
        self._refused[f"{event.kind}_{reason}"] += 1
        self._event_log.log("info", f"{event.kind} refused", agent=event.agent, reason=reason, why=message)
        event.query.refuse(reason, message)

    def _answer(self, event: BusEvent) -> bytes | None:
        """The answer, or None if it has to wait."""
        assert event.query is not None
        if event.kind == "control":
            return self._commands.run(decode(ControlRequest, event.payload), event.query)
        # Before anything is read. An agent that joins too often can still leave.
        wait_s = self._rate.wait_s(f"{event.kind} {event.agent}", time.monotonic())
        if wait_s > 0.0:
            raise RequestRefused(
                "unavailable", f"agent = {event.agent}: asks to {event.kind} too often; wait {wait_s:.1f} s"
            )
        return self._join(event) if event.kind == "join" else self._leave(event)

    def _join(self, event: BusEvent) -> bytes:
        request = decode(JoinRequest, event.payload)
        _check_sender(event, request.agent)
        if self._is_ended():
            raise RequestRefused("ended", "the market is over")
        agent = self._admission.join(request)
        return encode(self._join_reply(agent))

    def _leave(self, event: BusEvent) -> bytes:
        request = decode(LeaveRequest, event.payload)
        _check_sender(event, request.agent)
        self._admission.leave(request)
        day, slot = self._next_slot()
        return encode(LeaveReply(day=day, slot=slot))


def _check_sender(event: BusEvent, agent: str) -> None:
    """Refuse a message that names another agent than its key, which certificates protect."""
    if event.agent != agent:
        raise RequestRefused("not_yours", f"agent = {agent}: asked for under the key of {event.agent}")
