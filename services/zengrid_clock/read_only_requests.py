"""Answers that only read: history and scenario. They run beside the market, in threads of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zengrid.wire.codec import decode, encode
from zengrid.wire.queries import HistoryReply, HistoryRequest, ScenarioReply, ScenarioRequest
from zengrid_clock.slot_records import settled_slot

if TYPE_CHECKING:
    from zengrid.journal import RunView


def history_reply(payload: bytes, journal: RunView, run: str) -> bytes:
    """Settled slots from a position on."""
    request = decode(HistoryRequest, payload)
    dt_h = journal.info.dt_h
    slots = tuple(
        settled_slot(record, journal.roster(record.roster_version), run, dt_h, homes=request.homes)
        for record in journal.records(since=request.since, limit=request.limit)
    )
    following = slots[-1].position + 1 if slots else request.since
    return encode(HistoryReply(run=run, next=following, slots=slots))


def scenario_reply(payload: bytes, yaml: str, run: str) -> bytes:
    """The scenario that the market plays."""
    decode(ScenarioRequest, payload)
    return encode(ScenarioReply(run=run, yaml=yaml))
