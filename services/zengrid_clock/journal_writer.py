"""Writes slots to the journal, and waits for a journal that cannot take one."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from zengrid import logs
from zengrid.errors import JournalError, JournalUnavailableError

if TYPE_CHECKING:
    from zengrid.journal import RosterRecord, RunTotals, RunWriter, SlotRecord

RETRY_S = 0.5
"""Pause before a journal that could not take a slot is tried again."""


class JournalWriter:
    """Writes one run.

    Parameters
    ----------
    run:
        The run in the journal.
    wait_s:
        How long to wait for a journal that cannot take a slot.
    is_ended:
        Whether the market was asked to end: then there is no wait.
    """

    def __init__(self, run: RunWriter, wait_s: float, is_ended: Callable[[], bool]) -> None:
        self._run = run
        self._wait_s = wait_s
        self._is_ended = is_ended
        self._away_since: float | None = None
        self.waits = 0
        """How often a slot had to wait."""

    @property
    def away_s(self) -> float:
        """How long the present wait has lasted; 0 if there is none. [s]"""
        return 0.0 if self._away_since is None else time.monotonic() - self._away_since

    def write(
        self,
        record: SlotRecord,
        roster: RosterRecord | None,
        totals: RunTotals | None,
        meanwhile: Callable[[float], object],
    ) -> None:
        """Write a slot.

        Parameters
        ----------
        roster:
            The roster of this slot, if it is a new one.
        totals:
            Sums of the slots before this one, if they are to be stored.
        meanwhile:
            Called during a wait with the time it may take [s], so that the clock remains responsive.

        Raises
        ------
        JournalError
            If the journal refuses the slot, or did not take it within the time.
        """
        last_message = ""
        while True:
            try:
                self._run.commit(record, roster, totals)
                break
            except JournalUnavailableError as error:
                self._count_wait(error)
                if str(error) != last_message:
                    last_message = str(error)
                    logs.print_message(f"waiting: {last_message}", "warning", day=record.day, slot=record.slot)
            until = time.monotonic() + RETRY_S
            while (left_s := until - time.monotonic()) > 0:
                meanwhile(left_s)
        if self._away_since is not None:
            text = f"going on: slot {record.slot} of day {record.day} is settled, after {self.away_s:.1f} s"
            self._away_since = None
            logs.print_message(text, "warning", day=record.day, slot=record.slot)

    def _count_wait(self, error: JournalUnavailableError) -> None:
        """Count the wait, and end it if the market is to end or has waited long enough."""
        if self._away_since is None:
            self._away_since = time.monotonic()
            self.waits += 1
        if self._is_ended():
            raise error
        if self.away_s >= self._wait_s:
            raise JournalError(f"given up after {self._wait_s:g} s: {error}")
