"""How a run fares beside the same days without demand response."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from zengrid.journal import RunTotals
from zengrid.wire.queries import Status, Totals

Floats = NDArray[np.float64]


class Kpi(BaseModel):
    """One figure beside its value without demand response."""

    value: float = Field(examples=[41.2])
    conventional: float = Field(description="Without demand response.", examples=[30.1])
    change: float | None = Field(description="Relative change [-]; null where it cannot be said.", examples=[0.369])

    @classmethod
    def of(cls, value: float, conventional: float) -> Kpi:
        """With the relative change."""
        change = (value - conventional) / abs(conventional) if abs(conventional) > 1e-9 else None
        return cls(value=value, conventional=conventional, change=change)


class Kpis(BaseModel):
    """How a run fares."""

    run: str = Field(examples=["main-1"])
    slots: int = Field(description="Settled slots.", examples=[168])
    profit: Kpi = Field(description="Of the grid [$].")
    bills: Kpi = Field(description="Of all homes together [$].")
    reserve_kwh: Kpi = Field(description="Energy of all facilities but the first [kWh].")
    curtailed_kwh: float = Field(description="Energy nobody could take [kWh].", examples=[0.0])
    unserved_kwh: float = Field(description="Demand nobody could meet [kWh].", examples=[0.0])
    prosumers: dict[str, Kpi] = Field(description="Bill of each home [$].")


def of_run(run: str, totals: RunTotals) -> Kpis:
    """The figures of a run of the journal, of all homes that ever took part."""
    market = Totals.model_validate({"slots": totals.slots, **totals.market()})
    sums = totals.of_homes(totals.homes)
    return _kpis(run, market, totals.homes, sums["bill"], sums["baseline_bill"])


def of_status(status: Status) -> Kpis:
    """The figures of the running market; homes that have left count in the market's sums alone."""
    homes = status.homes
    if homes is None:
        return _kpis(status.run, status.totals, (), np.zeros(0), np.zeros(0))
    return _kpis(status.run, status.totals, homes.homes, homes.bill, homes.baseline_bill)


def _kpis(run: str, totals: Totals, homes: tuple[str, ...], bills: Floats, baseline_bills: Floats) -> Kpis:
    return Kpis(
        run=run,
        slots=totals.slots,
        profit=Kpi.of(totals.profit, totals.baseline_profit),
        bills=Kpi.of(totals.bills, totals.baseline_bills),
        reserve_kwh=Kpi.of(totals.reserve_kwh, totals.baseline_reserve_kwh),
        curtailed_kwh=totals.curtailed_kwh,
        unserved_kwh=totals.unserved_kwh,
        prosumers={
            home: Kpi.of(bill, baseline)
            for home, bill, baseline in zip(homes, bills.tolist(), baseline_bills.tolist(), strict=True)
        },
    )
