"""Days side by side are days in a loop over the core, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.core.baselines import conventional
from zengrid.core.observe import observe_grid, observe_prosumers, time_features
from zengrid.core.params import MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.env.vector import VectorMarket, beside, pick, slots_first
from zengrid.scenario import Days, load

DAYS = [10_000, 10_007, 3, 0]


def bits(settled: Settlement) -> list[bytes]:
    return [np.asarray(value).tobytes() for value in settled]


def draw(rng: np.random.Generator, lead: tuple[int, ...], homes: int) -> tuple[np.ndarray, np.ndarray]:
    return rng.choice([0.05, 0.08, 0.1], lead), rng.choice([-2.0, -1.0, 0.0, 0.5, 2.0], (*lead, homes))


@pytest.mark.parametrize("name", ["paper", "village"])
@pytest.mark.parametrize("slot_minutes", [60, 15])
def test_a_batch_of_days_is_a_loop_over_the_core(name: str, slot_minutes: int) -> None:
    scenario = load(name).with_(slot_minutes=slot_minutes)
    market, days = scenario.market(), Days(scenario)
    homes, slots = market.homes.count, scenario.slots_per_day
    prices, commands = draw(np.random.default_rng(1), (slots, len(DAYS)), homes)
    vector = VectorMarket(market, (len(DAYS),), scenario.buy_prices)
    vector.begin(slots_first(days.days(DAYS)), market.homes.soc_initial)
    socs = [market.homes.soc_initial] * len(DAYS)
    last: list[Settlement | None] = [None] * len(DAYS)
    for slot in range(slots):
        time = time_features(slot, market.dt_h)
        seen_grid, seen_homes = vector.grid_observation("public"), vector.prosumer_observation("public", prices[slot])
        batch = vector.step(prices[slot], commands[slot])
        for i, number in enumerate(DAYS):
            now, before = days.day(number).slot(slot), last[i]
            settled = settle(socs[i], Action(prices[slot, i], commands[slot, i]), now, market)
            assert bits(settled) == bits(Settlement(*(value[i] for value in batch)))
            homes_seen = observe_prosumers(
                "public", socs[i], now.pv_kw, now.load_kw, prices[slot, i], now.sell_price, time
            )
            assert homes_seen.tobytes() == seen_homes[i].tobytes()
            cost, payment, demand_kw = np.zeros(market.facilities.count), np.zeros(homes), np.zeros(())
            if before is not None:
                cost, payment, demand_kw = before.facility_cost, before.payment, before.demand_kw
            grid_seen = observe_grid("public", cost, payment, demand_kw, now.sell_price, time)
            assert grid_seen.tobytes() == seen_grid[i].tobytes()
            socs[i], last[i] = settled.soc, settled
    assert vector.over
    with pytest.raises(IndexError, match="the day has"):
        vector.step(0.05, commands[0])


def test_variants_side_by_side_are_the_variants_alone() -> None:
    scenario = load("paper")
    variants = [scenario.market().with_capacity(size) for size in (2.0, 9.0, 25.0)]
    days = slots_first(Days(scenario).days(DAYS))
    lead = (len(variants), len(DAYS))
    prices, commands = draw(np.random.default_rng(2), (scenario.slots_per_day, *lead), 3)
    together = VectorMarket(beside(variants), lead)
    together.begin(Exogenous(*(column[:, None] for column in days)), beside(variants).homes.soc_initial)
    alone = [VectorMarket(market, lead[1:]) for market in variants]
    for market in alone:
        market.begin(days, market.market.homes.soc_initial)
    for slot in range(scenario.slots_per_day):
        batch = together.step(prices[slot], commands[slot])
        for v, market in enumerate(alone):
            settled = market.step(prices[slot, v], commands[slot, v])
            assert bits(settled) == bits(Settlement(*(np.broadcast_to(x, (*lead, *x.shape[2:]))[v] for x in batch)))


def test_stored_energy_and_the_last_outcome_go_on_into_the_next_day() -> None:
    scenario = load("paper")
    days = slots_first(Days(scenario).days(DAYS))
    vector = VectorMarket(scenario.market(), (2,))
    vector.begin(pick(days, np.array([0, 1])), scenario.market().homes.soc_initial)
    while not vector.over:
        view = vector.prosumer_view(np.full(2, 0.05))
        settled = vector.step(np.full(2, 0.05), conventional(view.pv_kw, view.load_kw, view.homes))
    vector.begin(pick(days, np.array([2, 3])))
    assert vector.soc is settled.soc
    assert vector.grid_view().payment is settled.payment
    vector.begin(pick(days, np.array([2, 3])), scenario.market().homes.soc_initial)
    assert (vector.soc == scenario.market().homes.soc_initial).all()


def test_only_homes_may_differ_side_by_side() -> None:
    market = load("paper").market()
    with pytest.raises(ValueError, match="homes alone"):
        beside([market, MarketParams(market.homes, market.facilities, 0.25)])
    with pytest.raises(ValueError, match="equally many"):
        beside([market, market.with_homes(market.homes.take([0, 1]))])
