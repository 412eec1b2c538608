"""The state of the market as operators see it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid.wire.queries import AgentStatus, HomesStatus, Status, Totals

if TYPE_CHECKING:
    from zengrid.journal import RunTotals
    from zengrid.scenario import Scenario
    from zengrid.wire.slots import SettledSlot
    from zengrid_clock.agent_registry import AgentRegistry
    from zengrid_clock.journal_writer import JournalWriter
    from zengrid_clock.latencies import Latencies
    from zengrid_clock.live_market import LiveMarket
    from zengrid_clock.pace import Pace
    from zengrid_clock.run_state import RunState


@dataclass(frozen=True, slots=True)
class StatusReport:
    """Writes the status of one run.

    Parameters
    ----------
    run:
        Name of the market.
    days:
        Length of the run; None without end.
    refused:
        Counts of refusals, whose causes do not overlap.
    last_slot:
        The last settled slot, or None before the first.
    homes_status:
        The state of all homes.
    agent_slices:
        Where each agent's homes stand in the arrays.
    """

    run: str
    scenario: Scenario
    days: int | None
    state: RunState
    pace: Pace
    registry: AgentRegistry
    latencies: Latencies
    journal: JournalWriter
    refused: tuple[Counter[str], ...]
    last_slot: Callable[[], SettledSlot | None]
    homes_status: Callable[[], HomesStatus]
    agent_slices: Callable[[], Mapping[str, slice]]

    def write(self, *, with_homes: bool) -> Status:
        """The status now; with ``with_homes`` it lists every home."""
        scenario, state = self.scenario, self.state
        slices = self.agent_slices()
        return Status(
            run=self.run,
            scenario=scenario.name,
            seed=scenario.seed,
            state=self.pace.state,
            speed=self.pace.speed,
            day=state.day,
            slot=state.slot,
            slots_per_day=scenario.slots_per_day,
            dt_h=scenario.dt_h,
            days=self.days,
            slots_per_s=self.latencies.slots_per_s(time.perf_counter()),
            last=self.last_slot(),
            totals=_totals(state.totals),
            refused={cause: count for counter in self.refused for cause, count in counter.items()},
            journal_waits=self.journal.waits,
            journal_wait_s=self.journal.away_s,
            latency=self.latencies.summary(),
            agents=tuple(
                AgentStatus(
                    id=agent.id,
                    role=agent.role,
                    presence=agent.presence,
                    policy=agent.policy,
                    homes=slices[agent.id].stop - slices[agent.id].start if agent.id in slices else 0,
                    acted=agent.acted,
                    fallbacks=agent.fallbacks,
                    last_cause=agent.last_cause,
                )
                for agent in self.registry
            ),
            homes=self.homes_status() if with_homes else None,
        )


def _totals(totals: RunTotals) -> Totals:
    values: dict[str, Any] = totals.market()
    return Totals(slots=totals.slots, **values)


def homes_status(market: LiveMarket, totals: RunTotals, slot: int) -> HomesStatus:
    """The state of all homes: PV and load of a slot, outcome of the last settled slot, bills since the start."""
    last = market.last
    zeros = np.zeros(len(market.homes))
    sums = totals.of_homes(market.homes)
    profile = market.profile(slot) if market.day >= 0 else None
    return HomesStatus(
        homes=market.homes,
        agents=tuple(name for name, own in market.agents.items() for _ in range(own.stop - own.start)),
        capacity_kwh=market.params.homes.capacity_kwh,
        pv_rated_kw=np.array([spec.pv_kw for spec in market.specs], dtype=np.float64),
        soc=market.soc,
        battery_kw=zeros if last is None else last.battery_kw,
        injection_kw=zeros if last is None else last.injection_kw,
        pv_kw=zeros if profile is None else profile.pv_kw,
        load_kw=zeros if profile is None else profile.load_kw,
        bill=sums["bill"],
        baseline_bill=sums["baseline_bill"],
    )
