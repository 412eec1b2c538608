"""What a run came to, read from its journal: bills, profit and reserve energy beside those without demand response."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zengrid.journal import Journal, RunView

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pair:
    """A sum as it was, and as it would have been without demand response."""

    real: float
    conventional: float

    @property
    def difference(self) -> float:
        """What demand response made of it, in the same unit."""
        return self.real - self.conventional

    @property
    def percent(self) -> float | None:
        """The same as part of the conventional sum; None where that is next to nothing. [%]"""
        return None if abs(self.conventional) < 0.005 else 100.0 * self.difference / abs(self.conventional)


@dataclass(frozen=True, slots=True)
class Results:
    """Sums over a whole run."""

    slots: int
    bills: dict[str, Pair]
    """[$] by home, those that left included"""
    fallbacks: dict[str, int]
    """Slots in which the fallback acted, by home"""
    grid_fallbacks: int
    profit: Pair
    """[$]"""
    reserve: Pair
    """[kWh]"""
    curtailed_kwh: float
    unserved_kwh: float
    first_settled_at: float
    """Unix time [s]"""

    @property
    def all_bills(self) -> Pair:
        """All homes together. [$]"""
        pairs = self.bills.values()
        return Pair(sum(pair.real for pair in pairs), sum(pair.conventional for pair in pairs))


def latest(journal: Journal, run: str) -> RunView | None:
    """The last run of a market: the clock numbers them ``main-1``, ``main-2``, ..."""
    found = [info for info in journal.runs() if info.name.rpartition("-")[0] == run]
    return journal.run(found[-1].id) if found else None


def results(run: RunView) -> Results:
    """Add up a run that has settled something."""
    dt_h, slots, grid_fallbacks = run.info.dt_h, 0, 0
    profit, reserve, lost = np.zeros(2), np.zeros(2), np.zeros(2)
    homes: dict[str, Floats] = {}
    first_settled_at = 0.0
    for block in run.blocks():
        first_settled_at = first_settled_at or float(block["settled_at"][0])
        slots += len(block)
        grid_fallbacks += int(block["grid_fallback"].sum())
        profit += block["profit"].sum(), block["baseline_profit"].sum()
        reserve += block["facility_kw"][:, 1:].sum() * dt_h, block["baseline_facility_kw"][:, 1:].sum() * dt_h
        lost += (
            (block["curtailed_kw"] + block["home_curtailed_kw"]).sum() * dt_h,
            (block["unserved_kw"] + block["home_unserved_kw"]).sum() * dt_h,
        )
        columns = (block["bill"], block["baseline_bill"], block["fallback"])
        sums = np.stack([column.sum(axis=0) for column in columns], axis=-1)
        for home, row in zip(block.roster.homes, sums, strict=True):
            homes[home] = homes[home] + row if home in homes else row
    return Results(
        slots=slots,
        bills={home: Pair(float(row[0]), float(row[1])) for home, row in homes.items()},
        fallbacks={home: int(row[2]) for home, row in homes.items()},
        grid_fallbacks=grid_fallbacks,
        profit=Pair(*profit.tolist()),
        reserve=Pair(*reserve.tolist()),
        curtailed_kwh=float(lost[0]),
        unserved_kwh=float(lost[1]),
        first_settled_at=first_settled_at,
    )
