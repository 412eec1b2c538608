"""Rules: what they decide, and that whoever asks, in whichever order and batch, gets the same answer."""

from __future__ import annotations

import numpy as np
import pytest

from support.policy_days import PAPER, facts, grid_view, play
from zengrid.errors import PolicyError
from zengrid.policy.prices import price_schedule
from zengrid.policy.registry import make_grid_policy, make_prosumer_policy, prosumer_policy_files
from zengrid.policy.views import ProsumerView
from zengrid.scenario import Days

DAYS = Days(PAPER)
MARKET = PAPER.market()
FIXED = np.full(24, 0.05)


def view(day: int = 0, slot: int = 18, homes: slice = slice(None), lead: tuple[int, ...] = ()) -> ProsumerView:
    now = DAYS.day(day).slot(slot)
    told = facts(homes=homes).homes
    pv_kw, load_kw = (np.broadcast_to(column[homes], (*lead, told.count)) for column in (now.pv_kw, now.load_kw))
    return ProsumerView(day, slot, 1.0, np.full((*lead, told.count), 0.5), pv_kw, load_kw, 0.05, 0.095, told)


def test_conventional_is_the_core_rule() -> None:
    command = make_prosumer_policy("conventional", facts()).act(view(slot=12))
    now = DAYS.day(0).slot(12)
    assert command.tolist() == np.clip(now.pv_kw - now.load_kw, -2.0, 2.0).tolist()


def test_idle_leaves_the_battery_alone() -> None:
    assert make_prosumer_policy("idle", facts()).act(view()).tolist() == [0.0, 0.0, 0.0]


def test_random_draws_every_level_about_as_often() -> None:
    policy = make_prosumer_policy("random:3", facts())
    drawn = np.stack([policy.act(view(day, slot)) for day in range(20) for slot in range(24)])
    levels, counts = np.unique(drawn, return_counts=True)
    assert levels.tolist() == [-2.0, -1.0, 0.0, 1.0, 2.0]
    assert counts.min() > 0.8 * drawn.size / 5


def test_random_is_the_same_for_one_home_a_fleet_a_batch_and_a_restart() -> None:
    fleet = make_prosumer_policy("random:3", facts())
    together = [fleet.act(view(5, slot)) for slot in range(24)]
    # In another order, by other objects, each for one home.
    for home in range(3):
        one = slice(home, home + 1)
        for slot in reversed(range(24)):
            alone = make_prosumer_policy("random:seed=3", facts(homes=one)).act(view(5, slot, one))
            assert alone.tolist() == together[slot][one].tolist()
    many = view(0, 7, lead=(2, 4))._replace(day=np.arange(8).reshape(2, 4))
    batch = fleet.act(many)
    for day in range(8):
        assert batch[day // 4, day % 4].tolist() == fleet.act(view(day, 7)).tolist()
    assert fleet.act(view(0, 7, lead=(2, 4))).shape == (2, 4, 3)


def test_random_differs_by_seed_home_day_and_slot() -> None:
    def week(seed: int) -> np.ndarray:
        policy = make_prosumer_policy(f"random:{seed}", facts())
        return np.stack([policy.act(view(day, slot)) for day in range(7) for slot in range(24)]).reshape(7, 24, 3)

    first = week(1)
    assert not np.array_equal(first, week(2))
    for axis in range(3):
        assert not np.array_equal(np.take(first, 0, axis), np.take(first, 1, axis))


def test_a_played_batch_equals_single_days() -> None:
    profile = DAYS.days([0, 1, 2])
    wide = type(profile)(*(np.moveaxis(column, 1, 0) for column in profile))
    for text in ("conventional", "idle", "random:1"):
        policy = make_prosumer_policy(text, facts())
        together = play(policy, MARKET, wide, FIXED, day=np.arange(3))
        for day in range(3):
            alone = play(policy, MARKET, DAYS.day(day), FIXED, day=day)
            assert np.array_equal(together.battery_kw[:, day], alone.battery_kw)
            assert np.array_equal(together.bill[day], alone.bill)


def test_fixed_price_defaults_to_the_one_without_demand_response_or_the_lowest() -> None:
    paper = facts()
    assert make_grid_policy("fixed", paper).act(grid_view()) == 0.05
    assert make_grid_policy("fixed:0.07", paper).act(grid_view()) == 0.07
    other = facts(PAPER.with_(baseline_buy_price=0.08))
    assert make_grid_policy("fixed", other).act(grid_view()) == 0.08
    dear = facts(PAPER.with_(buy_prices=[0.06, 0.08]))
    assert make_grid_policy("fixed", dear).act(grid_view()) == 0.06


def test_time_of_use_changes_with_the_slot() -> None:
    policy = make_grid_policy("tou:0.05,18:00=0.09,21:00=0.05", facts())
    prices = [float(policy.act(grid_view(slot))) for slot in range(24)]
    assert prices == [0.05] * 18 + [0.09] * 3 + [0.05] * 3


def test_a_schedule_does_not_depend_on_the_slot_length() -> None:
    hourly = price_schedule("0.05,06:00=0.1,21:00=0.06", facts())
    quarters = price_schedule("0.05,06:00=0.1,21:00=0.06", facts(PAPER.with_(slot_minutes=15)))
    assert np.array_equal(np.repeat(hourly, 4), quarters)


def test_random_prices_are_levels_and_repeat() -> None:
    policy = make_grid_policy("random:9", facts())
    drawn = [float(policy.act(grid_view(slot, day))) for day in range(10) for slot in range(24)]
    assert set(drawn) == set(PAPER.buy_prices)
    again = make_grid_policy("random:9", facts())
    assert [float(again.act(grid_view(slot, day))) for day in range(10) for slot in range(24)] == drawn
    batch = np.asarray(again.act(grid_view(4, np.arange(10))))
    assert batch.tolist() == [drawn[24 * day + 4] for day in range(10)]


@pytest.mark.parametrize(
    ("role", "text", "words"),
    [
        ("prosumer", "clever", ["policy = clever", "conventional, idle, random, optimum", "*.safetensors"]),
        ("prosumer", "fixed", ["policy = fixed", "conventional"]),
        ("prosumer", "idle:3", ["idle takes nothing"]),
        ("prosumer", "random:-1", ["policy = random:-1", "seed = -1", "from 0 up"]),
        ("prosumer", "random:x", ["seed = x"]),
        ("prosumer", "random:\u0663", ["seed = "]),
        ("prosumer", f"random:{2**63}", ["seed = 9223372036854775808", "from 0 up to 9223372036854775807"]),
        ("prosumer", "random:" + "9" * 10_000, ["seed = 999", "from 0 up"]),
        ("prosumer", "random:3.safetensors", ["policy file random:3.safetensors", "cannot be read"]),
        ("prosumer", "optimum:seed=-3", ["policy = optimum:seed=-3", "seed = -3"]),
        ("prosumer", "optimum:prices=0.05,0.06", ["'0.06' is not understood"]),
        ("grid", "conventional", ["policy = conventional", "fixed, tou, random", "*.safetensors"]),
        ("grid", "fixed:0.055", ["buy price = 0.055", "0.05, 0.06, 0.07, 0.08, 0.09, 0.1 $/kWh"]),
        ("grid", "fixed:cheap", ["'cheap' is not a price"]),
        ("grid", "fixed:nan", ["buy price = nan"]),
        ("grid", "tou:", ["is not understood", "such as 0.05,18:00=0.09"]),
        ("grid", "tou:18:00=0.09", ["is not understood"]),
        ("grid", "tou:0.05,0.06", ["'0.06' is not understood"]),
        ("grid", "tou:0.05,25:00=0.06", ["'25:00=0.06' is not understood"]),
        ("grid", "tou:0.05,18:30=0.06", ["begins within a slot", "60 min"]),
        ("grid", "tou:0.05,18:00=0.06,18:00=0.07", ["must begin later"]),
        ("grid", "tou:0.05,18:00=0.2", ["buy price = 0.2"]),
        ("grid", "tou:e.", ["'e.' is not a price"]),
        ("prosumer", "nowhere.safetensors", ["policy file nowhere.safetensors", "cannot be read"]),
    ],
)
def test_what_is_wrong_is_named(role: str, text: str, words: list[str]) -> None:
    make = make_grid_policy if role == "grid" else make_prosumer_policy
    with pytest.raises(PolicyError) as error:
        make(text, facts())
    for word in words:
        assert word in str(error.value)


def test_what_a_policy_would_read_is_known_without_a_market() -> None:
    for text in ("trained", "generic", "conventional", "idle", "random:7", "optimum:scenario=paper,seed=3,prices=0.05"):
        assert prosumer_policy_files(text) == ()
    assert prosumer_policy_files("../x.safetensors") == ("../x.safetensors",)
    assert prosumer_policy_files("optimum:scenario=mine.yaml,data=../homes") == ("mine.yaml", "../homes")
    for text in (
        "clever",
        "random:x",
        "idle:3",
        "optimum:seed=x",
        "optimum:all=1",
        "optimum:prices=cheap",
        "trained:x",
    ):
        with pytest.raises(PolicyError, match=f"policy = {text}: "):
            prosumer_policy_files(text)
