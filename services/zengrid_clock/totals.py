"""What the market adds up to since the run began, beside its twin without demand response."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid.wire.requests import Totals

if TYPE_CHECKING:
    from zengrid.journal import Block, SlotRecord

_REPORTED = (
    "profit", "conventional_profit", "bills", "conventional_bills", "reserve_kwh", "conventional_reserve_kwh",
    "curtailed_kwh", "unserved_kwh",
)  # fmt: skip


class Sums:
    """Sums over settled slots."""

    def __init__(self, dt_h: float) -> None:
        self.slots = 0
        self._dt_h = dt_h
        self._values = np.zeros(len(_REPORTED))

    def add(self, record: SlotRecord) -> None:
        """Count one slot."""
        dt_h = self._dt_h
        self.slots += 1
        self._values += (
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
        self.slots += len(block)
        curtailed_kw = block["curtailed_kw"] + block["home_curtailed_kw"]
        unserved_kw = block["unserved_kw"] + block["home_unserved_kw"]
        columns = (
            block["profit"], block["conventional_profit"], block["bill"], block["conventional_bill"],
            block["facility_kw"][:, 1:] * dt_h, block["conventional_facility_kw"][:, 1:] * dt_h,
            curtailed_kw * dt_h, unserved_kw * dt_h,
        )  # fmt: skip
        self._values += [float(np.sum(column)) for column in columns]

    def report(self) -> Totals:
        """For the status."""
        values: dict[str, Any] = dict(zip(_REPORTED, self._values.tolist(), strict=True))
        return Totals(slots=self.slots, **values)
