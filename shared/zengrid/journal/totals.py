"""What a run adds up to, beside its twin without demand response; kept in the journal as one array of float64."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.columns import FLOAT
from zengrid.journal.record import SlotRecord
from zengrid.journal.roster import Roster

Floats = NDArray[np.float64]

TOTALS = (
    "profit", "conventional_profit", "bills", "conventional_bills", "reserve_kwh", "conventional_reserve_kwh",
    "curtailed_kwh", "unserved_kwh",
)  # fmt: skip


class Totals:
    """Sums over all settled slots: of the market [$, kWh], and of each home that takes part now [$].

    Whoever has them need not read the slots again: a clock that resumes, and ``prune``, which deletes them.
    """

    def __init__(self, dt_h: float) -> None:
        self.slots = 0
        self.values = np.zeros(len(TOTALS))
        self.homes: tuple[str, ...] = ()
        self.bill: Floats = np.zeros(0)
        """(home,)"""
        self.conventional_bill: Floats = np.zeros(0)
        """(home,)"""
        self._dt_h = dt_h

    def bills(self, homes: tuple[str, ...]) -> tuple[Floats, Floats]:
        """Sums of these homes' bills, and what they would be without demand response, ``(home,)`` each. [$]"""
        if homes is self.homes or homes == self.homes:
            return self.bill, self.conventional_bill
        before = {home: i for i, home in enumerate(self.homes)}
        at = np.array([before.get(home, -1) for home in homes], np.intp)
        # The last entry is what a new home begins with.
        return np.append(self.bill, 0.0)[at], np.append(self.conventional_bill, 0.0)[at]

    def _follow(self, homes: tuple[str, ...]) -> None:
        """Go on with other homes: those that stay keep their sums, those that come begin at zero."""
        self.bill, self.conventional_bill = self.bills(homes)
        self.homes = homes

    def add(self, record: SlotRecord, homes: tuple[str, ...]) -> None:
        """Count one slot."""
        dt_h = self._dt_h
        self._follow(homes)
        self.slots += 1
        self.bill = self.bill + record.bill
        self.conventional_bill = self.conventional_bill + record.conventional_bill
        self.values += (
            record.profit,
            record.conventional_profit,
            float(np.add.reduce(record.bill)),
            float(np.add.reduce(record.conventional_bill)),
            float(np.add.reduce(record.facility_kw[1:])) * dt_h,
            float(np.add.reduce(record.conventional_facility_kw[1:])) * dt_h,
            (record.curtailed_kw + record.home_curtailed_kw) * dt_h,
            (record.unserved_kw + record.home_unserved_kw) * dt_h,
        )

    def add_block(self, block: Block) -> None:
        """Count the slots of a piece of a journal."""
        dt_h = self._dt_h
        self._follow(block.roster.homes)
        self.slots += len(block)
        self.bill = self.bill + np.add.reduce(block["bill"])
        self.conventional_bill = self.conventional_bill + np.add.reduce(block["conventional_bill"])
        columns = (
            block["profit"], block["conventional_profit"], block["bill"], block["conventional_bill"],
            block["facility_kw"][:, 1:] * dt_h, block["conventional_facility_kw"][:, 1:] * dt_h,
            (block["curtailed_kw"] + block["home_curtailed_kw"]) * dt_h,
            (block["unserved_kw"] + block["home_unserved_kw"]) * dt_h,
        )  # fmt: skip
        self.values += [float(np.sum(column)) for column in columns]

    def encode(self, roster_version: int) -> bytes:
        """As the journal keeps it: version of the roster whose homes these are, slots, sums, bills."""
        head = (float(roster_version), float(self.slots))
        return np.concatenate([head, self.values, self.bill, self.conventional_bill]).astype(FLOAT).tobytes()

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
        _, made.values, made.bill, made.conventional_bill = (
            part.copy() for part in np.split(numbers, np.cumsum([2, len(TOTALS), count]))
        )
        return made
