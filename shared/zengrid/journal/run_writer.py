"""A run of the journal for its one writer, the clock."""

from __future__ import annotations

import time

from zengrid.errors import JournalError, JournalUnavailableError
from zengrid.journal.database import Database, Row, Step, Writer
from zengrid.journal.roster_record import RosterRecord
from zengrid.journal.run_view import Query, RunInfo, RunView
from zengrid.journal.slot_columns import HOME_ARRAYS
from zengrid.journal.slot_record import SlotRecord
from zengrid.journal.totals import RunTotals


class RunWriter(RunView):
    """Commits slot after slot. Once ``commit`` returns, the slot survives the death of the process."""

    def __init__(self, query: Query, database: Database, info: RunInfo) -> None:
        super().__init__(query, database.statements, info)
        self._database = database
        self._writer: Writer | None = None
        self._closed = False
        self._slots_per_day = info.slots_per_day
        self._open()
        try:
            self.position = self._checked_count()
            roster = self._checked_roster() if self.position else None
        except BaseException:
            self.close()
            raise
        self._roster_version = roster.version if roster else None
        self._homes = len(roster.homes) if roster else 0

    def commit(self, record: SlotRecord, roster: RosterRecord | None = None, totals: RunTotals | None = None) -> None:
        """Store a settled slot, and the roster if it changed, in one transaction.

        Parameters
        ----------
        totals:
            Sums over the slots before this one, to be stored with it. Once in many slots is enough.

        Raises
        ------
        JournalUnavailableError
            The database refused the slot, is not reachable, or lets another process write this run. The same record can
            be committed again once the cause is fixed, even if the database stored it and could not confirm.
        JournalError
            The slot does not follow the last one, or does not fit its roster.
        """
        if record.position != self.position:
            raise JournalError(f"position = {record.position}: run {self.name!r} continues at position {self.position}")
        if record.day * self._slots_per_day + record.slot != self.position:
            raise JournalError(
                f"day = {record.day}, slot = {record.slot}: position {self.position} is day "
                f"{self.position // self._slots_per_day}, slot {self.position % self._slots_per_day}"
            )
        version, homes = self._follows(roster) if roster is not None else (self._roster_version, self._homes)
        if record.roster_version != version:
            raise JournalError(f"roster_version = {record.roster_version}: the roster in force is version {version}")
        row = record.encode(homes)
        steps: list[Step] = [(self._sql.insert_slot, (self.id, *row))]
        if roster is not None:
            steps.insert(0, (self._sql.insert_roster, (self.id, roster.version, record.position, roster.encode())))
        if totals is not None and self.position:
            # Before the slot: a writer counts the bytes of the last step.
            steps.insert(0, (self._sql.write_totals, (self.position, totals.encode(), self.id)))
        try:
            # After a failed attempt the database may hold the slot (the connection broke before the answer). Look for
            # it under the lock: without the lock, the lost connection may still commit.
            again = self._writer is None
            writer = self._open()
            if not (again and self._stored(row)):
                writer.commit(steps)
        except BaseException as error:
            self._release()
            if isinstance(error, (*self._database.errors, JournalUnavailableError)):
                raise JournalUnavailableError(
                    f"journal {self._database.name}: slot {record.slot} of day {record.day} is not settled, and can be "
                    f"committed again when this is fixed: {' '.join(str(error).split())}"
                ) from error
            raise
        self.position += 1
        self._roster_version, self._homes = version, homes
        if roster is not None:
            # So that the last slot can be read even if the database is not reachable.
            self._rosters[roster.version] = (record.position, roster)

    def finish(self) -> None:
        """Mark the run as complete, so that it cannot be resumed, and release the right to write."""
        try:
            self._open().commit([(self._sql.finish_run, (time.time(), self.id))])
        except self._database.errors as error:
            self._release()
            raise JournalError(f"journal {self._database.name}: run {self.name!r} is not finished: {error}") from error
        self.close()

    def close(self) -> None:
        """Release the right to write; the run can be resumed."""
        self._closed = True
        self._release()

    def _open(self) -> Writer:
        """Return the writer; after a failed commit a new one."""
        if self._writer is None:
            if self._closed:
                raise JournalError(f"run {self.name!r} is closed: resume it to write to it")
            self._writer = self._database.writer(self.id, self.name)
        return self._writer

    def _release(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()

    def _checked_count(self) -> int:
        count, positions = self._query(self._sql.count, (self.id,))[0][0], self.count()
        kept = positions - self.kept_from()
        if count != kept:
            raise JournalError(
                f"journal {self._database.name} is damaged: run {self.name!r} holds {count} of {kept} slots"
            )
        return positions

    def _checked_roster(self) -> RosterRecord:
        """Return the roster in force; raises JournalError if the last slot does not fit it."""
        roster, last = self.roster(), self.last()
        if last is None or last.roster_version != roster.version:
            raise JournalError(f"journal {self._database.name} is damaged: run {self.name!r} ends under another roster")
        for name in HOME_ARRAYS:
            if getattr(last, name).shape != (len(roster.homes),):
                raise JournalError(
                    f"journal {self._database.name} is damaged: in the last slot of run {self.name!r} (day {last.day}, "
                    f"slot {last.slot}) {name} holds {getattr(last, name).size} of {len(roster.homes)} homes"
                )
        return roster

    def _follows(self, roster: RosterRecord) -> tuple[int, int]:
        if self._roster_version is not None and roster.version <= self._roster_version:
            raise JournalError(f"roster.version = {roster.version}: must be above {self._roster_version}")
        if len(roster.specs) != len(roster.homes) or len(set(roster.homes)) != len(roster.homes):
            raise JournalError(
                f"roster {roster.version}: {len(roster.homes)} homes must be distinct and have a spec each"
            )
        return roster.version, len(roster.homes)

    def _stored(self, row: Row) -> bool:
        """Whether the database holds the slot of an attempt that seemed to fail."""
        found = self._query(self._sql.slots, (self.id, self.position, self.position + 1))
        if found and tuple(found[0]) != row:
            raise JournalError(f"run {self.name!r}: another writer settled position {self.position} differently")
        return bool(found)
