"""A day is the same day: in any order, any batch, any company."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zengrid.core.state import Exogenous
from zengrid.errors import ScenarioError
from zengrid.scenario import Days, HomeSpec, LoadSpec, Scenario, load

DAY_LISTS = st.lists(st.integers(0, 2**40), min_size=1, max_size=12)
# One each: a typical day at two slot lengths, homes drawn at random, many homes of one orientation each.
MARKETS = [load("paper"), load("paper").with_(slot_minutes=15), load("village")]


@pytest.fixture(scope="module", params=MARKETS, ids=["paper", "paper 15 min", "village"])
def scenario(request: pytest.FixtureRequest) -> Scenario:
    market: Scenario = request.param
    return market


def same(one: Exogenous, other: Exogenous) -> None:
    for left, right in zip(one, other, strict=True):
        np.testing.assert_array_equal(left, right)


@given(numbers=DAY_LISTS)
@settings(max_examples=25, deadline=None)
def test_a_batch_is_its_days_bit_for_bit(numbers: list[int]) -> None:
    for market in MARKETS:
        days, batch = Days(market), Days(market).days(numbers)
        same(batch, Exogenous(*map(np.stack, zip(*(days.day(number) for number in numbers), strict=True))))


@given(order=st.permutations(range(12)))
@settings(max_examples=20, deadline=None)
def test_the_order_of_asking_does_not_matter(order: list[int]) -> None:
    days, fresh = Days(MARKETS[0]), Days(MARKETS[0])
    for number in order:
        same(days.day(number), fresh.days([number, *order]).slot(0))


def test_days_made_in_portions_are_the_same_days(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Days(scenario).days(range(9))
    monkeypatch.setattr("zengrid.scenario.days._PORTION", 1)
    same(whole, Days(scenario).days(range(9)))


def test_shapes_and_memory_are_what_the_core_wants(scenario: Scenario) -> None:
    slots, homes, consumers = scenario.slots_per_day, len(scenario.homes), len(scenario.consumers)
    day, batch = Days(scenario).day(3), Days(scenario).days([3, 4])
    assert [a.shape for a in day] == [(slots, homes), (slots, homes), (slots, consumers), (slots,)]
    assert [a.shape for a in batch] == [(2, *a.shape) for a in day]
    for array in (*day, *batch):
        assert array.flags.c_contiguous
        assert array.dtype == np.float64
        assert array.min() >= 0.0
    assert all(array.flags.writeable for array in batch)


def test_days_differ_and_seeds_differ(scenario: Scenario) -> None:
    days, other = Days(scenario), Days(scenario.with_(seed=1))
    assert not np.array_equal(days.day(0).load_kw, days.day(1).load_kw)
    assert not np.array_equal(days.day(0).load_kw, other.day(0).load_kw)
    assert not np.array_equal(days.day(0).pv_kw, days.day(1).pv_kw)


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_home_that_joins_gets_what_the_scenario_would_give_it(scenario: Scenario, place: int) -> None:
    home = scenario.homes[place]
    without = scenario.with_(homes=[h.model_dump() for h in scenario.homes if h.id != home.id], fleets=None)
    pv_kw, load_kw = Days(without).home_day(home, 5)
    day = Days(scenario).day(5)
    np.testing.assert_array_equal(pv_kw, day.pv_kw[:, place])
    np.testing.assert_array_equal(load_kw, day.load_kw[:, place])


def test_homes_do_not_change_each_other(scenario: Scenario) -> None:
    half = scenario.with_(homes=[home.model_dump() for home in reversed(scenario.homes[:2])], fleets=None)
    day, reversed_half = Days(scenario).day(5), Days(half).day(5)
    np.testing.assert_array_equal(day.load_kw[:, 1::-1], reversed_half.load_kw)
    np.testing.assert_array_equal(day.pv_kw[:, 1::-1], reversed_half.pv_kw)


def test_many_joining_homes_at_once_are_the_same_homes(scenario: Scenario) -> None:
    days = Days(scenario)
    homes = [HomeSpec(id=f"new{i}", pv_kw=i, seed=i % 2) for i in range(4)]
    pv_kw, load_kw = days.homes_day(homes, 7)
    for place, home in enumerate(homes):
        alone = days.home_day(home, 7)
        np.testing.assert_array_equal(alone[0], pv_kw[:, place])
        np.testing.assert_array_equal(alone[1], load_kw[:, place])


def test_a_home_with_nothing_said_takes_the_first_homes_load(paper: Scenario) -> None:
    quiet = Days(paper.with_(noise="off"))
    pv_kw, load_kw = quiet.home_day(HomeSpec(id="p4", pv_kw=5), 0)
    np.testing.assert_array_equal(load_kw, quiet.day(0).load_kw[:, 0])
    np.testing.assert_allclose(pv_kw, quiet.day(0).pv_kw[:, 0] * 1.25)


def test_a_home_with_a_direction_gets_the_sites_sun(paper: Scenario) -> None:
    quiet = Days(paper.with_(noise="off"))
    east, west = (quiet.home_day(HomeSpec(id="x", pv_kw=1, azimuth_deg=deg), 0)[0] for deg in (90, 270))
    assert np.argmax(east) < 12 < np.argmax(west)


def test_a_seed_of_its_own_gives_a_home_other_days(paper: Scenario) -> None:
    days, home = Days(paper), paper.homes[0]
    assert not np.array_equal(days.home_day(home, 0)[1], days.home_day(home.model_copy(update={"seed": 1}), 0)[1])


def test_unknown_profiles_are_refused_by_name(paper: Scenario) -> None:
    with pytest.raises(ScenarioError, match=r'home p4: load.profile = "x".*prosumer1, prosumer2, prosumer3, consumer'):
        Days(paper).home_day(HomeSpec(id="p4", load=LoadSpec(profile="x")), 0)
    with pytest.raises(ScenarioError, match=r'consumers.0.profiles = "x"'):
        Days(paper.with_(**{"consumers.0.profiles": ["x"]}))


def test_pv_without_sun_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"home h001: .*needed: site"):
        Days(load("village").with_(site=None))


@pytest.mark.parametrize("numbers", [[-1], [[0, 1]]])
def test_only_days_from_0_up_exist(paper: Scenario, numbers: list[int]) -> None:
    with pytest.raises(ScenarioError, match="permitted: a list of numbers from 0"):
        Days(paper).days(numbers)


def test_an_empty_batch_is_empty(paper: Scenario) -> None:
    assert Days(paper).days([]).pv_kw.shape == (0, 24, 3)


class TestNoise:
    def test_off_is_exactly_the_profile(self, paper: Scenario) -> None:
        for minutes in (60, 15):
            quiet = Days(paper.with_(noise="off", slot_minutes=minutes))
            file = Path(str(load.__code__.co_filename)).parent / "data" / f"paper_{minutes}min.csv"
            rows = np.loadtxt(file, delimiter=",", skiprows=1, usecols=range(1, 6))
            for number in (0, 77, 20_000):
                day = quiet.day(number)
                np.testing.assert_array_equal(day.pv_kw, np.repeat(rows[:, :1], 3, axis=1))
                np.testing.assert_array_equal(day.load_kw, rows[:, 1:4])
                np.testing.assert_array_equal(day.consumer_kw, rows[:, 4:])

    def test_clouds_take_the_share_they_are_given(self, paper: Scenario) -> None:
        clear = Days(paper.with_(noise="off")).day(0).pv_kw.sum()
        for share in (0.1, 0.3):
            pv_kw = Days(paper.with_(**{"noise.cloudiness": share})).days(range(2000)).pv_kw
            assert pv_kw.sum(axis=(1, 2)).mean() / clear == pytest.approx(1 - share, abs=0.01)
            assert pv_kw.sum(axis=(1, 2)).max() <= clear

    def test_all_homes_have_the_same_sky(self, paper: Scenario) -> None:
        pv_kw = Days(paper).day(3).pv_kw
        np.testing.assert_array_equal(pv_kw[:, 0], pv_kw[:, 2])

    def test_loads_vary_as_much_as_they_are_told(self, paper: Scenario) -> None:
        quiet = Days(paper.with_(noise="off")).day(0).load_kw
        level = Days(paper.with_(noise={"load_level": 0.2})).days(range(2000)).load_kw / quiet
        assert np.ptp(level, axis=1).max() < 1e-12
        assert level[:, 0].std(axis=0) == pytest.approx([0.2] * 3, rel=0.05)
        slots = Days(paper.with_(noise={"load_noise": 0.2})).days(range(500)).load_kw / quiet
        assert slots.std() == pytest.approx(0.2, rel=0.02)
        assert np.corrcoef(slots[..., 0].ravel(), slots[..., 1].ravel())[0, 1] == pytest.approx(0.0, abs=0.03)

    def test_many_customers_together_vary_less(self, paper: Scenario) -> None:
        steady = Days(paper.with_(**{"consumers.0.noise_share": 0.0}))
        np.testing.assert_array_equal(steady.day(0).consumer_kw, Days(paper.with_(noise="off")).day(0).consumer_kw)


class TestSplit:
    @given(training=st.integers(0, 3000), evaluation=st.integers(0, 3000))
    @settings(max_examples=30, deadline=None)
    def test_typical_days_never_overlap(self, training: int, evaluation: int) -> None:
        days = Days(MARKETS[0])
        one, other = days.training(training), days.evaluation(evaluation)
        assert (len(set(one.tolist())), len(set(other.tolist()))) == (training, evaluation)
        assert not set(one.tolist()) & set(other.tolist())

    def test_a_live_market_begins_with_days_kept_for_evaluation(self, paper: Scenario) -> None:
        assert Days(paper).evaluation(3).tolist() == [0, 1, 2]
        assert Days(paper).training(2).tolist() == [10_000, 10_001]

    def test_evaluation_days_are_finite(self, paper: Scenario) -> None:
        with pytest.raises(
            ScenarioError, match=r"11 days for evaluation; permitted: 1 to 10 \(split.evaluation_days\)"
        ):
            Days(paper.with_(**{"split.evaluation_days": 10})).evaluation(11)

    def test_days_have_labels_and_no_dates_without_measured_data(self, paper: Scenario) -> None:
        days: Days = Days(paper)
        assert (days.count, days.label(12), days.date(12)) == (None, "day 12", None)


def test_a_city_is_made_in_time() -> None:
    """10,000 homes are a matter of arrays: a loop over homes would take a second or more."""
    import time

    days = Days(load("city"))
    took = []
    for number in range(3):
        start = time.perf_counter()
        days.day(number)
        took.append(time.perf_counter() - start)
    assert min(took) < 0.25
