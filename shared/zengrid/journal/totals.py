"""What a run adds up to, beside its baseline without demand response; kept in the journal as one array of float64."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.columns import FLOAT
from zengrid.journal.record import SlotRecord
from zengrid.journal.roster import Roster

Floats = NDArray[np.float64]

TOTALS = (
    "profit", "baseline_profit", "bills", "baseline_bills", "reserve_kwh", "baseline_reserve_kwh",
    "curtailed_kwh", "unserved_kwh",
)  # fmt: skip
_COUNTED = (
    "profit", "baseline_profit", "bill", "baseline_bill", "facility_kw", "baseline_facility_kw",
    "curtailed_kw", "home_curtailed_kw", "unserved_kw", "home_unserved_kw",
)  # fmt: skip
"""What of a slot is added up."""


QUEUED_SLOTS, QUEUED_VALUES = 64, 10_000
"""So many slots, or values of one column, wait to be added up at once: one by one each costs as much as all of them."""


class Totals:
    """Sums over all settled slots: of the market [$, kWh], and of each home that takes part now [$].

    Whoever has them need not read the slots again: a clock that resumes, and ``prune``, which deletes them.
    """

    def __init__(self, dt_h: float) -> None:
        self.slots = 0
        """All that were added."""
        self._values = np.zeros(len(TOTALS))
        self.homes: tuple[str, ...] = ()
        self._bill: Floats = np.zeros(0)
        """(home,)"""
        self._conventional_bill: Floats = np.zeros(0)
        """(home,)"""
        self._dt_h = dt_h
        self._queue: list[SlotRecord] = []
        """Slots of these homes that are not in the sums yet."""

    @property
    def values(self) -> Floats:
        """Of the market, in the order of ``TOTALS``."""
        self._add_queue()
        return self._values

    def bills(self, homes: tuple[str, ...]) -> tuple[Floats, Floats]:
        """Sums of these homes' bills, and what they would be without demand response, ``(home,)`` each. [$]"""
        self._add_queue()
        if homes is self.homes or homes == self.homes:
            return self._bill, self._conventional_bill
        before = {home: i for i, home in enumerate(self.homes)}
        at = np.array([before.get(home, -1) for home in homes], np.intp)
        # The last entry is what a new home begins with.
        return np.append(self._bill, 0.0)[at], np.append(self._conventional_bill, 0.0)[at]

    def add(self, record: SlotRecord, homes: tuple[str, ...]) -> None:
        """Count one slot."""
        if homes is not self.homes:
            self._follow(homes)
        self.slots += 1
        self._queue.append(record)
        if len(self._queue) >= QUEUED_SLOTS or len(self._queue) * len(homes) >= QUEUED_VALUES:
            self._add_queue()

    def add_block(self, block: Block) -> None:
        """Count the slots of a piece of a journal."""
        self._follow(block.roster.homes)
        self.slots += len(block)
        self._add(block.columns)

    def _follow(self, homes: tuple[str, ...]) -> None:
        """Go on with other homes: those that stay keep their sums, those that come begin at zero."""
        self._bill, self._conventional_bill = self.bills(homes)
        self.homes = homes

    def _add_queue(self) -> None:
        queue, self._queue = self._queue, []
        if queue:
            self._add({name: np.array([getattr(record, name) for record in queue]) for name in _COUNTED})

    def _add(self, columns: Mapping[str, NDArray[Any]]) -> None:
        dt_h = self._dt_h
        self._bill = self._bill + np.add.reduce(columns["bill"])
        self._conventional_bill = self._conventional_bill + np.add.reduce(columns["baseline_bill"])
        added = (
            columns["profit"], columns["baseline_profit"], columns["bill"], columns["baseline_bill"],
            columns["facility_kw"][:, 1:] * dt_h, columns["baseline_facility_kw"][:, 1:] * dt_h,
            (columns["curtailed_kw"] + columns["home_curtailed_kw"]) * dt_h,
            (columns["unserved_kw"] + columns["home_unserved_kw"]) * dt_h,
        )  # fmt: skip
        self._values = self._values + [float(np.sum(column)) for column in added]

    def encode(self, roster_version: int) -> bytes:
        """As the journal keeps it: version of the roster whose homes these are, slots, sums, bills."""
        head = (float(roster_version), float(self.slots))
        self._add_queue()
        return np.concatenate([head, self._values, self._bill, self._conventional_bill]).astype(FLOAT).tobytes()

    @staticmethod
    def roster_version(data: bytes) -> int:
        """Whose bills they are."""
        return int(np.frombuffer(data[: FLOAT.itemsize], FLOAT)[0])

    @classmethod
    def decode(cls, data: bytes, roster: Roster, dt_h: float) -> Self:
        """The inverse of ``encode``."""
        numbers, count = np.frombuffer(data, FLOAT), len(roster.homes)
        if numbers.size != 2 + len(TOTALS) + 2 * count:
            raise JournalError(f"the journal is damaged: its totals are not those of {count} homes")
        made = cls(dt_h)
        made.slots, made.homes = int(numbers[1]), roster.homes
        _, made._values, made._bill, made._conventional_bill = (
            part.copy() for part in np.split(numbers, np.cumsum([2, len(TOTALS), count]))
        )
        return made
