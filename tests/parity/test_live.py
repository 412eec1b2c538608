"""Parity: the core in a loop, in a batch, and live processes over real Zenoh settle the same, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.core.state import Settlement
from zengrid.env.vector import VectorMarket, slots_first
from zengrid.journal import Journal, SlotRecord
from zengrid.policy.facts import MarketFacts
from zengrid.policy.registry import make_grid_policy, make_prosumer_policy
from zengrid.scenario import Days, Scenario, load
from zengrid.testing import RunningMarket

DAYS = 3
COMPARED = ("soc", "battery_kw", "injection_kw", "bill", "demand_kw", "facility_kw", "facility_cost", "curtailed_kw",
            "unserved_kw", "revenue", "profit", "lost_load_cost")  # fmt: skip

CASES = [
    ("daily", "random:3", "random:5"),
    ("daily", "conventional", "tou:0.05,17:00=0.09,22:00=0.06"),
    ("never", "random:7", "fixed:0.08"),
]


def facts(scenario: Scenario, homes: slice) -> MarketFacts:
    """What the policies of some homes are told."""
    return MarketFacts(
        dt_h=scenario.dt_h,
        slots_per_day=scenario.slots_per_day,
        buy_prices=tuple(scenario.buy_prices),
        sell_prices=tuple(scenario.sell_prices),
        baseline_buy_price=scenario.baseline_buy_price,
        battery_levels=scenario.battery_levels,
        facilities=scenario.market().facilities.count,
        home_ids=scenario.home_ids[homes],
        homes=scenario.market().homes.take(np.arange(len(scenario.home_ids))[homes]),
    )


def in_a_loop(scenario: Scenario, prosumer: str, grid: str) -> list[Settlement]:
    """Slot after slot, every home with a policy of its own, as the live market does."""
    market, days = VectorMarket(scenario.market(), (), scenario.buy_prices), Days(scenario)
    alone = [slice(i, i + 1) for i in range(market.homes)]
    policies = [make_prosumer_policy(prosumer, facts(scenario, home)) for home in alone]
    price_policy = make_grid_policy(grid, facts(scenario, slice(0, 0)))
    results = []
    for day in range(DAYS):
        market.begin(
            days.day(day), market.market.homes.soc_initial if day == 0 or scenario.soc_reset == "daily" else None, day
        )
        while not market.over:
            price = price_policy.act(market.grid_view())
            command = [
                policy.act(market.prosumer_view(price, home)) for policy, home in zip(policies, alone, strict=True)
            ]
            results.append(market.step(price, np.concatenate(command)))
    return results


def in_a_batch(scenario: Scenario, prosumer: str, grid: str) -> list[Settlement]:
    """All days side by side, all homes by one policy; for days that start alike."""
    market = VectorMarket(scenario.market(), (DAYS,), scenario.buy_prices)
    policy = make_prosumer_policy(prosumer, facts(scenario, slice(None)))
    price_policy = make_grid_policy(grid, facts(scenario, slice(0, 0)))
    market.begin(slots_first(Days(scenario).days(np.arange(DAYS))), market.market.homes.soc_initial)
    results = []
    while not market.over:
        view = market.grid_view()
        price = np.array([price_policy.act(view._replace(day=day)) for day in range(DAYS)])
        seen = market.prosumer_view(price)
        # Rules that depend on the number of the day are asked day by day; all days are settled at once.
        command = [policy.act(seen._replace(day=day))[day] for day in range(DAYS)]
        results.append(market.step(price, np.stack(command)))
    return [
        Settlement(*(column[day] for column in results[slot]))
        for day in range(DAYS)
        for slot in range(scenario.slots_per_day)
    ]


def live(scenario: Scenario, prosumer: str, grid: str) -> list[SlotRecord]:
    """Real processes over real Zenoh."""
    options = ("--days", str(DAYS), "--soc-reset", scenario.soc_reset, "--deadline", "20")
    with RunningMarket(scenario.name, options) as market:
        market.start_agents(*scenario.home_ids, policy=prosumer, grid_policy=grid)
        assert market.processes["clock"].end(200) == 0, market.output()
        with Journal.open(market.journal, read_only=True) as journal:
            return journal.run().records()


@pytest.mark.parametrize(("soc_reset", "prosumer", "grid"), CASES)
def test_every_settlement_is_the_same_to_the_last_bit(soc_reset: str, prosumer: str, grid: str) -> None:
    scenario = load("paper").with_(soc_reset=soc_reset)
    looped = in_a_loop(scenario, prosumer, grid)
    if soc_reset == "daily":
        for one, other in zip(looped, in_a_batch(scenario, prosumer, grid), strict=True):
            for name, a, b in zip(Settlement._fields, one, other, strict=True):
                assert np.asarray(a).tobytes() == np.asarray(b).tobytes(), name
    records = live(scenario, prosumer, grid)
    assert len(records) == len(looped) == DAYS * scenario.slots_per_day
    for record, settled in zip(records, looped, strict=True):
        assert not record.fallback.any()
        for name in COMPARED:
            a, b = np.asarray(getattr(record, name)), np.asarray(getattr(settled, name))
            assert a.tobytes() == b.tobytes(), (record.position, name, a, b)
    assert len({record.buy_price for record in records}) > (1 if ":" in grid and "fixed" not in grid else 0)
