"""A settled slot as the journal keeps it, as the public sees it, and as operators see it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from zengrid.core.state import Exogenous, Settlement
from zengrid.journal import Roster as RosterRecord
from zengrid.journal import SlotRecord
from zengrid.journal.record import BaselineSlot
from zengrid.wire.slots import HomeColumns, SettledSlot
from zengrid_clock.roster import GRID

if TYPE_CHECKING:
    from zengrid_clock.service import Clock


class Played(NamedTuple):
    """A slot that was settled but is not in the journal yet."""

    settled: Settlement
    baseline: BaselineSlot
    exogenous: Exogenous
    day: int
    slot: int
    times_s: tuple[float, float, float]
    """Of its price phase, its battery phase, and of settling it."""


def slot_record(clock: Clock, played: Played) -> SlotRecord:
    """What is journalled of the last slot, while those who played it still take part."""
    market = clock.market
    fallback = np.zeros(len(market.homes), dtype=np.bool_)
    for agent in clock.roster.prosumers.values():
        if not agent.acted_last:
            fallback[market.agents[agent.id]] = True
    return SlotRecord.of(
        position=clock.position,
        day=played.day,
        slot=played.slot,
        settled_at=time.time(),
        buy_price=clock.buy_price,
        exogenous=played.exogenous,
        settled=played.settled,
        baseline=played.baseline,
        fallback=fallback,
        grid_fallback=not clock.roster.grid.acted_last,
        roster_version=clock.desk.roster_version,
    )


def roster_record(clock: Clock, version: int) -> RosterRecord:
    """Who the columns of the coming records belong to."""
    agents = tuple(
        (agent.id, tuple(clock.market.homes[clock.market.agents[agent.id]]), agent.instance)
        for agent in clock.roster.prosumers.values()
    )
    return RosterRecord(
        version=version,
        homes=clock.market.homes,
        specs=tuple(spec.model_dump(mode="json") for spec in clock.market.specs),
        agents=(("grid", (), clock.roster.grid.instance), *agents),
    )


def public_slot(clock: Clock, record: SlotRecord) -> dict[str, Any]:
    """What everybody may know of the last slot, while those who played it still take part: ``PublicSlot``'s fields."""
    dt_h = clock.scenario.dt_h
    fallback = record.fallback.tolist()
    missed = {GRID: record.grid_fallback, **{name: fallback[mine.start] for name, mine in clock.market.agents.items()}}
    return {
        "v": 1,
        "run": clock.hub.keys.run,
        "day": record.day,
        "slot": record.slot,
        "position": record.position,
        "hour": record.slot * dt_h,
        "dt_h": dt_h,
        "state": "running" if clock.pace.state == "waiting" else clock.pace.state,
        "buy_price": record.buy_price,
        "sell_price": record.sell_price,
        "demand_kw": record.demand_kw,
        "export_kw": record.export_kw,
        "facility_kw": record.facility_kw,
        "facility_cost": record.facility_cost,
        "curtailed_kwh": (record.curtailed_kw + record.home_curtailed_kw) * dt_h,
        "unserved_kwh": (record.unserved_kw + record.home_unserved_kw) * dt_h,
        "homes": len(record.soc),
        "acted": [name for name in missed if not missed[name]],
        "fallback": [name for name in missed if missed[name]],
    }


def settled_slot(clock: Clock, record: SlotRecord, *, homes: bool) -> SettledSlot:
    """A slot as operators see it, from the journal alone."""
    dt_h = clock.scenario.dt_h
    roster = clock.run.roster(record.roster_version)
    fallback = tuple(name for name, missed in zip(roster.homes, record.fallback, strict=True) if missed)
    missed = set(fallback)
    agents = {name: bool(mine) and mine[0] in missed for name, mine, _ in roster.agents}
    agents["grid"] = record.grid_fallback
    detail = None
    if homes:
        detail = HomeColumns(
            homes=roster.homes,
            soc=record.soc,
            battery_kw=record.battery_kw,
            injection_kw=record.injection_kw,
            pv_kw=record.pv_kw,
            load_kw=record.load_kw,
            bill=record.bill,
            baseline_soc=record.baseline_soc,
            baseline_bill=record.baseline_bill,
            fallback=fallback,
        )
    return SettledSlot(
        run=clock.hub.keys.run,
        day=record.day,
        slot=record.slot,
        position=record.position,
        hour=record.slot * dt_h,
        dt_h=dt_h,
        state="running",
        buy_price=record.buy_price,
        sell_price=record.sell_price,
        demand_kw=record.demand_kw,
        export_kw=record.export_kw,
        facility_kw=record.facility_kw,
        facility_cost=record.facility_cost,
        curtailed_kwh=(record.curtailed_kw + record.home_curtailed_kw) * dt_h,
        unserved_kwh=(record.unserved_kw + record.home_unserved_kw) * dt_h,
        homes=len(roster.homes),
        acted=tuple(name for name, missing in agents.items() if not missing),
        fallback=tuple(name for name, missing in agents.items() if missing),
        profit=record.profit,
        baseline_profit=record.baseline_profit,
        baseline_facility_kw=record.baseline_facility_kw,
        detail=detail,
    )
