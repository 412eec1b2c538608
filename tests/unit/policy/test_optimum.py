"""The prosumer that knows the future plays its best response, live, side by side, and after a restart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.policy_days import PAPER, facts, play
from zengrid.core.bounds import best_response
from zengrid.errors import PolicyError
from zengrid.policy.optimum import Options, foresight_of, make_optimum
from zengrid.policy.registry import make_prosumer_policy
from zengrid.policy.views import ProsumerPolicy
from zengrid.scenario import Days

Floats = NDArray[np.float64]

DAYS = Days(PAPER)
MARKET = PAPER.market()
SCHEDULE = "0.05,18:00=0.09,19:00=0.1,22:00=0.08,23:00=0.05"
PRICES = np.array([0.05] * 18 + [0.09] + [0.10] * 3 + [0.08] + [0.05])


def optimum(options: str = f":prices={SCHEDULE}", homes: slice = slice(None)) -> ProsumerPolicy:
    return make_prosumer_policy("optimum" + options, facts(homes=homes))


def bound(day: int, prices: Floats = PRICES) -> Floats:
    profile = DAYS.day(day)
    return best_response(MARKET, profile.pv_kw, profile.load_kw, prices, profile.sell_price).bill


def test_with_a_known_schedule_it_reaches_the_bound() -> None:
    policy = optimum()
    for day in range(3):
        np.testing.assert_allclose(play(policy, MARKET, DAYS.day(day), PRICES, day).bill, bound(day), atol=1e-9)


def test_without_a_schedule_it_expects_the_prices_of_the_day_before() -> None:
    policy = optimum("")
    first = play(policy, MARKET, DAYS.day(0), PRICES, 0).bill
    second = play(policy, MARKET, DAYS.day(1), PRICES, 1).bill
    assert np.all(first >= bound(0) - 1e-9)
    assert np.any(first > bound(0) + 0.01)
    np.testing.assert_allclose(second, bound(1), atol=1e-9)


def test_under_a_constant_price_it_needs_to_have_seen_nothing() -> None:
    flat = np.full(24, 0.05)
    np.testing.assert_allclose(play(optimum(""), MARKET, DAYS.day(0), flat).bill, bound(0, flat), atol=1e-9)


def test_a_surprising_price_is_used_at_once() -> None:
    """The plan expects 0.05 all day; the hour in which the grid pays 0.10 is the one to sell in."""
    prices = np.full(24, 0.05)
    prices[0] = 0.10
    played = play(optimum(":prices=0.05"), MARKET, DAYS.day(0), prices)
    assert np.all(played.battery_kw[0] == -2.0)


def test_each_home_alone_and_days_side_by_side_command_the_same() -> None:
    profile = DAYS.days([0, 1, 2, 3])
    wide = type(profile)(*(np.moveaxis(column, 1, 0) for column in profile))
    for options in ("", f":prices={SCHEDULE}"):
        together = play(optimum(options), MARKET, wide, np.repeat(PRICES[:, None], 4, axis=1), np.arange(4))
        for day in range(4):
            for home in range(3):
                one = slice(home, home + 1)
                alone = optimum(options, one)
                own = DAYS.day(day)._replace(pv_kw=DAYS.day(day).pv_kw[:, one], load_kw=DAYS.day(day).load_kw[:, one])
                market = MARKET.with_homes(MARKET.homes.take([home]))
                assert np.array_equal(
                    play(alone, market, own, PRICES, day).battery_kw, together.battery_kw[:, day, one]
                )


def test_an_optimum_restarted_in_a_day_continues_unchanged() -> None:
    whole = play(optimum(), MARKET, DAYS.day(2), PRICES, 2)
    again = play(optimum(), MARKET, DAYS.day(2), PRICES, 2, soc=whole.settled[9].soc, first=10)
    assert np.array_equal(again.battery_kw, whole.battery_kw[10:])


def test_where_energy_carries_over_it_keeps_some_for_tomorrow() -> None:
    tariff = [{"from": "00:00", "price": 0.095}, {"from": "18:00", "price": 0.05}]
    carrying, flat = PAPER.with_(soc_reset="never", tariff=tariff), np.full(24, 0.05)
    day = Days(carrying).day(0)
    policy = make_prosumer_policy("optimum:prices=0.05", facts(carrying))
    assert np.all(play(policy, MARKET, day, flat).settled[-1].soc > 0.2)
    # Where batteries are reset tonight, what is left is worth nothing.
    reset = make_prosumer_policy("optimum:prices=0.05", facts(carrying.with_(soc_reset="daily")))
    np.testing.assert_allclose(play(reset, MARKET, day, flat).settled[-1].soc, 0.1, atol=1e-12)


def test_another_days_profiles_are_noticed() -> None:
    with pytest.raises(PolicyError, match=r"home p\d on day 0, slot \d+ is .* kW off what was foreseen"):
        play(optimum(), MARKET, DAYS.day(1), PRICES, 0)


def test_another_seed_can_be_asked_for() -> None:
    days = Days(PAPER.with_(seed=PAPER.seed + 1))
    policy = optimum(f":scenario=paper,seed={PAPER.seed + 1},prices={SCHEDULE}")
    assert play(policy, MARKET, days.day(0), PRICES).bill.shape == (3,)


def test_a_home_that_was_brought_can_be_foreseen() -> None:
    brought = PAPER.homes[0].model_copy(update={"id": "p9", "pv_kw": 6.0})
    told = replace(facts(homes=slice(1)), home_ids=("p9",), foresight=foresight_of(PAPER, [brought]))
    pv_kw, load_kw = DAYS.homes_day([brought], 4)
    own = DAYS.day(4)._replace(pv_kw=pv_kw, load_kw=load_kw)
    market = MARKET.with_homes(told.homes)
    found = play(make_prosumer_policy(f"optimum:prices={SCHEDULE}", told), market, own, PRICES, 4)
    best = best_response(market, pv_kw, load_kw, PRICES, own.sell_price)
    np.testing.assert_allclose(found.bill, best.bill, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (":seed=x", ["seed = x", "from 0 up"]),
        (":scenario=nowhere", ["scenario = nowhere", "paper"]),
        (":horizon=3", ["horizon: permitted are scenario, seed, data"]),
        (":prices=0.03", ["buy price = 0.03"]),
        (":scenario=village", ["scenario = village does not have home p1"]),
    ],
)
def test_what_is_wrong_is_named(options: str, words: list[str]) -> None:
    with pytest.raises(PolicyError) as error:
        optimum(options)
    for word in ["policy = optimum", *words]:
        assert word in str(error.value)


def test_without_any_scenario_it_says_what_it_needs() -> None:
    with pytest.raises(PolicyError, match="must know the future: give scenario=NAME"):
        make_optimum(replace(facts(), scenario=""), Options())
    with pytest.raises(PolicyError, match="has 24 slots a day, the market 96"):
        make_optimum(facts(PAPER.with_(slot_minutes=15)), Options("paper"))
