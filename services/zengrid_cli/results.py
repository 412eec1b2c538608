"""What a run came to, read from its journal: bills, profit and reserve energy beside those without demand response."""

from __future__ import annotations

from dataclasses import dataclass

from zengrid.journal import Journal, RunView


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
    all_bills: Pair
    """All homes together [$]"""
    first_settled_at: float | None
    """Unix time [s]; None if the first slot was pruned"""


def latest(journal: Journal, run: str) -> RunView | None:
    """The last run of a market: the clock numbers them ``main-1``, ``main-2``, ..."""
    found = [info for info in journal.runs() if info.name.rpartition("-")[0] == run]
    return journal.run(found[-1].id) if found else None


def results(run: RunView) -> Results:
    """Add up a run that has settled something."""
    totals = run.totals()
    market, homes = totals.market(), totals.of_homes(totals.homes)
    bills = zip(totals.homes, homes["bill"].tolist(), homes["baseline_bill"].tolist(), strict=True)
    return Results(
        slots=totals.slots,
        bills={home: Pair(bill, baseline) for home, bill, baseline in bills},
        fallbacks={home: int(count) for home, count in zip(totals.homes, homes["fallback"].tolist(), strict=True)},
        grid_fallbacks=totals.grid_fallbacks,
        profit=Pair(market["profit"], market["baseline_profit"]),
        reserve=Pair(market["reserve_kwh"], market["baseline_reserve_kwh"]),
        all_bills=Pair(market["bills"], market["baseline_bills"]),
        curtailed_kwh=market["curtailed_kwh"],
        unserved_kwh=market["unserved_kwh"],
        first_settled_at=None if run.kept_from() else run.records(limit=1)[0].settled_at,
    )
