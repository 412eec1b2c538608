"""Statuses of markets of any size, as a clock answers them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from zengrid.wire.queries import AgentStatus, Histogram, HomesStatus, Latency, Status, Totals
from zengrid.wire.slots import SettledSlot


def latency() -> Latency:
    """Two slots, with the same times for every phase."""
    times = Histogram(bounds_ms=(1.0, 2.0), counts=(0, 2, 0), sum_ms=2.5)
    percentiles: dict[str, Any] = {name: 1.25 for name in Latency.model_fields if name.endswith("_ms")}
    return Latency(price=times, battery=times, commit=times, **percentiles)


def agent(name: str, homes: int = 1, **changes: Any) -> AgentStatus:
    """A prosumer agent that is doing well."""
    fields = {
        "id": name, "role": "prosumer", "presence": "present", "policy": "conventional", "homes": homes, "acted": 10,
        "fallbacks": 0, "last_cause": "",
    }  # fmt: skip
    return AgentStatus(**{**fields, **changes})


def status(sizes: Sequence[int] = (1, 1, 1), scale: float = 1.0, **changes: Any) -> Status:
    """A market with one agent per entry, of so many homes; ``scale`` multiplies all powers and money."""
    homes = sum(sizes)
    names = [f"a{i}" for i in range(len(sizes))]
    of_home = tuple(name for name, size in zip(names, sizes, strict=True) for _ in range(size))
    ramp = np.arange(homes, dtype=np.float64)
    columns = HomesStatus(
        homes=tuple(f"h{i}" for i in range(homes)),
        agents=of_home,
        capacity_kwh=np.where(ramp % 4 == 3, 0.0, 10.0),
        pv_rated_kw=np.full(homes, 4.0),
        soc=0.1 + 0.8 * (ramp + 1) / (homes + 1),
        battery_kw=scale * (ramp - 1.0),
        injection_kw=scale * ramp,
        pv_kw=scale * 2.0 * ramp,
        load_kw=scale * (ramp + 0.5),
        bill=scale * (ramp - 1.0),
        baseline_bill=scale * ramp,
    )
    last = SettledSlot(
        run="main", day=2, slot=14, position=62, hour=14.0, dt_h=1.0, state="running", buy_price=0.07, sell_price=0.095,
        demand_kw=23.4 * scale, export_kw=4.2 * scale, facility_kw=np.array([19.2, 0.5]) * scale,
        facility_cost=np.array([1.0, 0.2]), curtailed_kwh=0.0, unserved_kwh=0.25 * scale, homes=homes,
        acted=tuple(names), fallback=(), profit=1.5 * scale, baseline_profit=1.2 * scale,
        baseline_facility_kw=np.array([20.0, 1.0]) * scale, detail=None,
    )  # fmt: skip
    grid = agent("grid", 0, role="grid", policy="fixed")
    fields: dict[str, Any] = {
        "run": "main", "scenario": "paper", "seed": 1, "state": "running", "speed": 0.0, "day": 2, "slot": 15,
        "slots_per_day": 24, "dt_h": 1.0, "days": 7, "slots_per_s": 912.3, "last": last,
        "totals": Totals(
            slots=63, profit=137.0 * scale, baseline_profit=100.0 * scale, bills=62.0 * scale,
            baseline_bills=100.0 * scale, reserve_kwh=70.0 * scale, baseline_reserve_kwh=100.0 * scale,
            curtailed_kwh=0.0, unserved_kwh=0.0,
        ),
        "refused": {}, "journal_waits": 0, "journal_wait_s": 0.0, "latency": latency(),
        "agents": (grid, *(agent(name, size) for name, size in zip(names, sizes, strict=True))), "homes": columns,
    }  # fmt: skip
    return Status(**{**fields, **changes})
