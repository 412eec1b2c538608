"""Results of a run, added up from its journal: bills, profit and reserve energy beside the baseline."""

from __future__ import annotations

from dataclasses import dataclass

from zengrid.journal import Journal, RunView
from zengrid_cli.live_view.number_format import NEGLIGIBLE


@dataclass(frozen=True, slots=True)
class ComparedSum:
    """A sum over a run, and the same sum in the baseline."""

    real: float
    baseline: float

    @property
    def difference(self) -> float:
        """Difference from the baseline, in the same unit."""
        return self.real - self.baseline

    @property
    def percent(self) -> float | None:
        """Difference as part of the baseline; None if the baseline is negligible. [%]"""
        return None if abs(self.baseline) < NEGLIGIBLE else 100.0 * self.difference / abs(self.baseline)


@dataclass(frozen=True, slots=True)
class RunResults:
    """Sums over a whole run."""

    slots: int
    bills: dict[str, ComparedSum]
    """[$] by home, with those that have left"""
    fallbacks: dict[str, int]
    """Slots in which the fallback acted, by home"""
    grid_fallbacks: int
    profit: ComparedSum
    """[$]"""
    reserve: ComparedSum
    """[kWh]"""
    curtailed_kwh: float
    unserved_kwh: float
    all_bills: ComparedSum
    """All homes together [$]"""
    first_settled_at: float | None
    """Unix time [s]; None if the first slot was pruned"""


def latest_run(journal: Journal, run: str) -> RunView | None:
    """The last run of a market: the clock numbers them ``main-1``, ``main-2``, ..."""
    found = [info for info in journal.runs() if info.name.rpartition("-")[0] == run]
    return journal.run(found[-1].id) if found else None


def add_up_run(run: RunView) -> RunResults:
    """Add up a run with at least one settled slot."""
    totals = run.totals()
    market, homes = totals.market(), totals.of_homes(totals.homes)
    bills = zip(totals.homes, homes["bill"].tolist(), homes["baseline_bill"].tolist(), strict=True)
    return RunResults(
        slots=totals.slots,
        bills={home: ComparedSum(bill, baseline) for home, bill, baseline in bills},
        fallbacks={home: int(count) for home, count in zip(totals.homes, homes["fallback"].tolist(), strict=True)},
        grid_fallbacks=totals.grid_fallbacks,
        profit=ComparedSum(market["profit"], market["baseline_profit"]),
        reserve=ComparedSum(market["reserve_kwh"], market["baseline_reserve_kwh"]),
        all_bills=ComparedSum(market["bills"], market["baseline_bills"]),
        curtailed_kwh=market["curtailed_kwh"],
        unserved_kwh=market["unserved_kwh"],
        first_settled_at=None if run.kept_from() else run.records(limit=1)[0].settled_at,
    )
