"""How a run fares beside the same days without demand response."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from pydantic import BaseModel, Field

from zengrid.wire.queries import Status
from zengrid_gateway.archive import Past


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


class Sums:
    """What a run of the journal adds up to; a longer run is read from where it was left."""

    FIGURES = ("profit", "baseline_profit", "curtailed_kwh", "unserved_kwh")

    def __init__(self) -> None:
        self.slots = 0
        self._market: defaultdict[str, float] = defaultdict(float)
        self._homes: defaultdict[str, Kpi] = defaultdict(lambda: Kpi.of(0.0, 0.0))

    def read_on(self, past: Past) -> Kpis:
        """Add what was settled since, and report. Blocks the calling thread."""
        settled = past.count()
        for part in past.parts(self.slots, settled, homes=True):
            for name in self.FIGURES:
                self._market[name] += float(part[name].sum())
            for name in ("facility_kw", "baseline_facility_kw"):
                self._market[name] += float(part[name][:, 1:].sum()) * past.dt_h
            bills, conventional = part["bill"].sum(axis=0), part["baseline_bill"].sum(axis=0)
            for home, bill, other in zip(part.homes, bills.tolist(), conventional.tolist(), strict=True):
                known = self._homes[home]
                self._homes[home] = Kpi.of(known.value + bill, known.conventional + other)
        self.slots = settled
        market = self._market
        return Kpis(
            run=past.name,
            slots=self.slots,
            profit=Kpi.of(market["profit"], market["baseline_profit"]),
            bills=Kpi.of(
                sum(kpi.value for kpi in self._homes.values()), sum(kpi.conventional for kpi in self._homes.values())
            ),
            reserve_kwh=Kpi.of(market["facility_kw"], market["baseline_facility_kw"]),
            curtailed_kwh=market["curtailed_kwh"],
            unserved_kwh=market["unserved_kwh"],
            prosumers=dict(self._homes),
        )


def of_status(status: Status) -> Kpis:
    """The running market's, as its clock tells them: homes that have left are in the sums alone."""
    totals, homes = status.totals, status.homes
    none = np.zeros(0)
    ids, bills, conventional = ((), none, none) if homes is None else (homes.homes, homes.bill, homes.baseline_bill)
    return Kpis(
        run=status.run,
        slots=totals.slots,
        profit=Kpi.of(totals.profit, totals.baseline_profit),
        bills=Kpi.of(totals.bills, totals.baseline_bills),
        reserve_kwh=Kpi.of(totals.reserve_kwh, totals.baseline_reserve_kwh),
        curtailed_kwh=totals.curtailed_kwh,
        unserved_kwh=totals.unserved_kwh,
        prosumers={
            home: Kpi.of(bill, other)
            for home, bill, other in zip(ids, bills.tolist(), conventional.tolist(), strict=True)
        },
    )
