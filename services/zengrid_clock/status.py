"""How the market stands: the clock's answer to operators."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid.journal import TOTALS
from zengrid.wire.requests import AgentStatus, HomesStatus, Status, Totals
from zengrid_clock.records import settled_slot

if TYPE_CHECKING:
    from zengrid_clock.service import Clock


def status(clock: Clock, *, homes: bool) -> Status:
    """Everything an operator wants to see at a glance."""
    scenario, record = clock.scenario, clock.last_record
    return Status(
        run=clock.hub.keys.run,
        scenario=scenario.name,
        seed=scenario.seed,
        state=clock.pace.state,
        speed=clock.pace.speed,
        day=clock.day,
        slot=clock.slot,
        slots_per_day=scenario.slots_per_day,
        dt_h=scenario.dt_h,
        days=clock.settings.days,
        slots_per_s=clock.latencies.slots_per_s(time.perf_counter()),
        last=None if record is None else settled_slot(clock, record, homes=False),
        totals=_totals(clock),
        refused={**clock.refused, **clock.hub.overflowed},
        journal_waits=clock.journal_waits,
        journal_wait_s=0.0 if clock.journal_away_since is None else time.monotonic() - clock.journal_away_since,
        latency=clock.latencies.summary(),
        agents=tuple(
            AgentStatus(
                id=agent.id,
                role=agent.role,
                presence=agent.presence,
                policy=agent.policy,
                homes=_count(clock, agent.id),
                acted=agent.acted,
                fallbacks=agent.fallbacks,
                last_cause=agent.last_cause,
            )
            for agent in clock.roster
        ),
        homes=_homes(clock) if homes else None,
    )


def _totals(clock: Clock) -> Totals:
    values: dict[str, Any] = dict(zip(TOTALS, clock.totals.values.tolist(), strict=True))
    return Totals(slots=clock.totals.slots, **values)


def _count(clock: Clock, agent: str) -> int:
    mine = clock.market.agents.get(agent)
    return 0 if mine is None else mine.stop - mine.start


def _homes(clock: Clock) -> HomesStatus:
    market, last = clock.market, clock.market.last
    zeros = np.zeros(len(market.homes))
    bill, baseline_bill = clock.totals.bills(market.homes)
    profile = market.profile(clock.slot) if market.day >= 0 else None
    return HomesStatus(
        homes=market.homes,
        agents=tuple(name for name, mine in market.agents.items() for _ in range(mine.stop - mine.start)),
        capacity_kwh=market.market.homes.capacity_kwh,
        pv_rated_kw=np.array([spec.pv_kw for spec in market.specs], dtype=np.float64),
        soc=market.soc,
        battery_kw=zeros if last is None else last.battery_kw,
        injection_kw=zeros if last is None else last.injection_kw,
        pv_kw=zeros if profile is None else profile.pv_kw,
        load_kw=zeros if profile is None else profile.load_kw,
        bill=bill,
        baseline_bill=baseline_bill,
    )
