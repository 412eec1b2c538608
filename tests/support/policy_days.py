"""What policies are told in tests, and days played by them slot by slot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.policy.facts import MarketFacts
from zengrid.policy.views import DayNumber, GridView, ProsumerPolicy, ProsumerView
from zengrid.scenario import Scenario, load

Floats = NDArray[np.float64]

PAPER = load("paper")


def facts(scenario: Scenario = PAPER, homes: slice = slice(None)) -> MarketFacts:
    """What the agent of some homes of a scenario is told."""
    ids = scenario.home_ids[homes]
    return MarketFacts(
        dt_h=scenario.dt_h,
        slots_per_day=scenario.slots_per_day,
        buy_prices=tuple(scenario.buy_prices),
        sell_prices=scenario.sell_prices,
        baseline_buy_price=scenario.baseline_buy_price,
        battery_levels=scenario.battery_levels,
        facilities=len(scenario.facilities),
        home_ids=ids,
        homes=scenario.market().homes.take(np.arange(len(scenario.home_ids))[homes]),
        soc_reset=scenario.soc_reset,
        scenario=scenario.name,
    )


class Played(NamedTuple):
    """A day: what was commanded ``(slot, ..., home)`` [kW], and what came of it."""

    battery_kw: Floats
    settled: list[Settlement]

    @property
    def bill(self) -> Floats:
        """``(..., home)`` [$]"""
        total: Floats = np.sum([slot.bill for slot in self.settled], axis=0)
        return total


def play(
    policy: ProsumerPolicy,
    market: MarketParams,
    profile: Exogenous,
    buy_price: Floats,
    day: DayNumber = 0,
    soc: Floats | None = None,
    first: int = 0,
) -> Played:
    """Play a day ``(slot, ...)`` with one policy for all homes, from a slot on."""
    state = market.homes.soc_initial if soc is None else soc
    state = np.broadcast_to(state, profile.pv_kw.shape[1:])
    commands, settled = [], []
    for slot in range(first, len(buy_price)):
        now = profile.slot(slot)
        prices = buy_price[slot], now.sell_price
        view = ProsumerView(day, slot, market.dt_h, state, now.pv_kw, now.load_kw, *prices, market.homes)
        commands.append(policy.act(view))
        settled.append(settle(state, Action(buy_price[slot], commands[-1]), now, market))
        state = settled[-1].soc
    return Played(np.stack(commands), settled)


def grid_view(slot: int = 0, day: DayNumber = 0, homes: int = 3, payment: Floats | None = None) -> GridView:
    """What a grid agent of the paper's market might see."""
    lead = np.shape(day) if payment is None else payment.shape[:-1]
    total = np.full(lead, 0.03 * homes) if payment is None else payment.sum(axis=-1)
    return GridView(
        day=day,
        slot=slot,
        dt_h=1.0,
        facility_cost=np.broadcast_to([0.6, 3.3], (*lead, 2)),
        payment=payment,
        payments=total,
        homes=homes,
        demand_kw=np.full(lead, 21.0),
        sell_price=np.full(lead, 0.095),
        buy_prices=np.array(PAPER.buy_prices),
    )
