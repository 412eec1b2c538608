"""Takes each slot from played through journalled to published."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from zengrid_clock.slot_records import PlayedSlot, slot_record

if TYPE_CHECKING:
    from zengrid.journal import RosterRecord, SlotRecord
    from zengrid_clock.journal_writer import JournalWriter
    from zengrid_clock.latencies import Latencies
    from zengrid_clock.run_state import RunState

TOTALS_SLOTS = 1000
"""How often the sums of all slots are journalled: a clock that resumes reads at most so many slots."""


class SlotPipeline:
    """Journals a slot before anyone hears of it, then publishes it.

    At full speed a slot is journalled while the grid agent decides about the next one. Only the grid agent knows the
    outcome by then, and the clock uses its answer only after the commit.

    Parameters
    ----------
    publish:
        Publishes a journalled slot.
    on_journalled:
        Called after each commit.
    """

    def __init__(
        self,
        state: RunState,
        journal: JournalWriter,
        latencies: Latencies,
        publish: Callable[[SlotRecord, RosterRecord], None],
        on_journalled: Callable[[SlotRecord], None],
    ) -> None:
        self._state = state
        self._journal = journal
        self._latencies = latencies
        self._publish = publish
        self._on_journalled = on_journalled
        self._played: PlayedSlot | None = None
        self._journalled: tuple[SlotRecord, RosterRecord] | None = None
        self._roster_version: int | None = None
        """Of the roster that the journal holds."""
        self.is_committing = False

    def add(self, played: PlayedSlot) -> None:
        """Take over a slot that was just played; the one before is journalled by now."""
        self._played = played

    def commit(self, meanwhile: Callable[[float], object]) -> None:
        """Write the played slot to the journal, if there is one.

        Parameters
        ----------
        meanwhile:
            See ``JournalWriter.write``.
        """
        played, self._played = self._played, None
        if played is None:
            return
        began = time.perf_counter()
        state, roster = self._state, played.roster
        record = slot_record(played, state.position)
        totals = state.totals if state.position % TOTALS_SLOTS == 0 else None
        self.is_committing = True
        self._journal.write(record, roster if roster.version != self._roster_version else None, totals, meanwhile)
        self.is_committing = False
        committed = time.perf_counter()
        self._roster_version = roster.version
        state.slot_journalled(record, roster.homes)
        self._journalled = record, roster
        self._on_journalled(record)
        price_s, battery_s, settle_s = played.durations_s
        self._latencies.add(price_s, battery_s, settle_s + committed - began, committed)

    def publish(self) -> None:
        """Publish the journalled slot, if it has not been published yet."""
        journalled, self._journalled = self._journalled, None
        if journalled is not None:
            self._publish(*journalled)
