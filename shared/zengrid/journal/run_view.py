"""A run of the journal for its readers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.database import Row
from zengrid.journal.roster_record import RosterRecord
from zengrid.journal.slot_columns import COLUMNS, COUNTS, FIGURES, FLOAT, HOME_ARRAYS, MARKET_COLUMNS, stack
from zengrid.journal.slot_record import SlotRecord
from zengrid.journal.statements import Statements
from zengrid.journal.totals import RunTotals

Query = Callable[[str, Row], list[Row]]

BLOCK_SLOTS = 4096
BLOCK_VALUES = 250_000
"""Most slots of a block, and most values in each of its arrays of homes."""
UNLIMITED = 2**31 - 1


@dataclass(frozen=True, slots=True)
class RunInfo:
    """Properties of a run."""

    id: int
    name: str
    seed: int
    dt_h: float
    """Length of a slot [h]"""
    version: str
    """of zengrid, when the run began"""
    started_at: float
    """Unix time [s]"""
    finished_at: float | None
    """Unix time [s]; None while the run can be resumed"""
    slots: int
    """Settled so far, pruned ones included"""

    @property
    def slots_per_day(self) -> int:
        """Slots of a day: position = day x slots_per_day + slot."""
        return round(24.0 / self.dt_h)


class RunView:
    """Reads one run, even while another process writes it."""

    def __init__(self, query: Query, statements: Statements, info: RunInfo) -> None:
        self._query = query
        self._sql = statements
        self.info = info
        self.id, self.name = info.id, info.name
        self._rosters: dict[int, tuple[int, RosterRecord]] = {}

    def scenario(self) -> str:
        """The scenario of the run, as YAML."""
        return str(self._query(self._sql.scenario, (self.id,))[0][0])

    def count(self) -> int:
        """Settled slots so far."""
        last = self._query(self._sql.last_position, (self.id,))[0][0]
        return 0 if last is None else int(last) + 1

    def kept_from(self) -> int:
        """Position of the first slot that was not pruned."""
        return int(self._query(self._sql.kept, (self.id,))[0][0])

    def totals(self, until: int | None = None, known: RunTotals | None = None) -> RunTotals:
        """Add up all slots before a position, pruned ones included; by default all there are.

        Parameters
        ----------
        known:
            Sums that an earlier call returned. Only the slots settled since are read, and added to them.

        Raises
        ------
        JournalError
            Some of these slots were pruned, and the sums in the journal already count later ones.
        """
        count = self.count()
        end = count if until is None else min(until, count)
        _, position, data = self._query(self._sql.kept, (self.id,))[0]
        totals = RunTotals(self.info.dt_h) if known is None or known.slots > end else known
        if data is not None and totals.slots < position <= end:
            totals = RunTotals.decode(data, self.info.dt_h)
        for block in self.blocks(totals.slots, end):
            if int(block["position"][0]) == totals.slots:
                totals.add_block(block)
        if totals.slots != end:
            raise JournalError(f"run {self.name!r}: the slots from position {totals.slots} on were pruned")
        return totals

    def last(self) -> SlotRecord | None:
        """The last settled slot, which is the state to resume from."""
        count = self.count()
        return self.records(count - 1)[0] if count else None

    def records(self, since: int = 0, until: int | None = None, limit: int = 1000) -> list[SlotRecord]:
        """Settled slots from position ``since`` to before ``until``, at most ``limit``."""
        first = max(since, self.kept_from())
        end = min(UNLIMITED if until is None else until, first + limit)
        return [SlotRecord.decode(row) for row in self._query(self._sql.slots, (self.id, first, end))]

    def blocks(self, since: int = 0, until: int | None = None, *, homes: bool = True) -> Iterator[Block]:
        """Settled slots in blocks of bounded size, each under one roster.

        Without ``homes`` the arrays of homes are neither read nor returned.
        """
        names, sql = (COLUMNS, self._sql.slots) if homes else (MARKET_COLUMNS, self._sql.market)
        end = self.count() if until is None else min(until, self.count())
        width = max((len(roster.homes) for _, roster in self.rosters()), default=0) if homes else 0
        step = max(1, min(BLOCK_SLOTS, BLOCK_VALUES // max(width, 1)))
        for start in range(max(since, self.kept_from()), end, step):
            rows = self._query(sql, (self.id, start, min(start + step, end)))
            for version, same in groupby(rows, key=itemgetter(names.index("roster_version"))):
                columns = {
                    name: _column(name, cells) for name, cells in zip(names, zip(*same, strict=True), strict=True)
                }
                block = Block(self.roster(version), columns)
                if homes and columns["soc"].shape[1] != len(block.roster.homes):
                    raise JournalError(
                        f"the journal is damaged: the arrays from position {columns['position'][0]} hold "
                        f"{columns['soc'].shape[1]} homes, roster version {version} has {len(block.roster.homes)}"
                    )
                yield block

    def home(self, home: str, since: int = 0, until: int | None = None) -> dict[str, NDArray[Any]]:
        """History of one home: position, day, slot and its values in the arrays of homes, each ``(slot,)``."""
        rosters = self.rosters()
        if not any(home in roster.homes for _, roster in rosters):
            raise JournalError(f"run {self.name!r}: home {home!r} never took part")
        rows: list[Row] = []
        end = UNLIMITED if until is None else until
        starts = [*(start for start, _ in rosters), end]
        for (start, roster), stop in zip(rosters, starts[1:], strict=True):
            if home in roster.homes:
                at = roster.homes.index(home)
                offsets = (8 * at + 1,) * (len(HOME_ARRAYS) - 1)
                rows += self._query(self._sql.home, (*offsets, at + 1, self.id, max(start, since), min(stop, end)))
        names = ("position", "day", "slot", *HOME_ARRAYS)
        columns = zip(*rows, strict=True) if rows else [()] * len(names)
        return {
            name: stack(name, cells).ravel() if name in HOME_ARRAYS and cells else _column(name, cells)
            for name, cells in zip(names, columns, strict=True)
        }

    def days(self, first: int = 0, until: int | None = None) -> range:
        """Positions of the slots from day ``first`` to before day ``until``."""
        each, count = self.info.slots_per_day, self.count()
        end = count if until is None else min(until * each, count)
        return range(max(first * each, self.kept_from()), end)

    def rosters(self) -> list[tuple[int, RosterRecord]]:
        """Every roster with the position of its first slot, in order."""
        for version, position, body in self._query(self._sql.rosters, (self.id,)):
            if version not in self._rosters:
                self._rosters[version] = (position, RosterRecord.decode(version, body))
        return list(self._rosters.values())

    def roster(self, version: int | None = None) -> RosterRecord:
        """The roster of a version, or the one in force."""
        if version is None or version not in self._rosters:
            self.rosters()
        try:
            return self._rosters[max(self._rosters) if version is None else version][1]
        except (KeyError, ValueError):
            raise JournalError(f"run {self.name!r}: the journal holds no roster {version or ''}".rstrip()) from None


def _column(name: str, cells: tuple[Any, ...]) -> NDArray[Any]:
    if name in COUNTS:
        return np.array(cells, np.int64)
    if name in FIGURES or not cells:
        return np.array(cells, FLOAT)
    return stack(name, cells)
