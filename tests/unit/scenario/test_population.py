"""Homes drawn from distributions: the same for the same seed, each by itself, of sensible sizes."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.errors import ScenarioError
from zengrid.scenario import load


def test_a_home_is_the_same_in_a_larger_population() -> None:
    village = load("village")
    larger = village.with_(**{"population.count": 300})
    assert [home.id for home in larger.homes] == [home.id for home in village.homes] + [
        f"h{i}" for i in range(101, 301)
    ]
    assert larger.homes[:100] == village.homes


def test_another_seed_draws_other_homes_and_the_scenarios_does_not() -> None:
    village = load("village")
    assert village.with_(seed=9).homes == village.homes
    assert village.with_(**{"population.seed": 9}).homes != village.homes


def test_a_citys_homes_are_as_the_distributions_say() -> None:
    city = load("city")
    homes = city.homes
    assert len(homes) == 10_000
    pv_kw = np.array([home.pv_kw for home in homes])
    assert 1.5 <= pv_kw.min() < 2.5
    assert 6.0 < pv_kw.max() <= 7.0
    assert pv_kw.mean() == pytest.approx(4.25, abs=0.05)
    assert set(pv_kw * 2 % 1) == {0.0}
    without = sum(home.battery.capacity_kwh == 0 for home in homes)
    assert without == pytest.approx(1500, abs=150)
    assert sum(home.load.profile == "retired" for home in homes) == pytest.approx(1500, abs=150)
    sizes = np.array([home.battery.capacity_kwh for home in homes])
    assert abs(np.corrcoef(pv_kw, sizes)[0, 1]) < 0.05


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("pv_kw", {"min": 1}, "population.pv_kw: permitted: min and max, or weights"),
        ("pv_kw", {"min": 1, "max": 2, "weights": {1: 1}}, "population.pv_kw: permitted: min and max, or weights"),
        ("pv_kw", {"min": 3, "max": 1}, r"population.pv_kw.max = 1: permitted from min = 3 up"),
        ("pv_kw", {"min": -3, "max": 1}, r"population.pv_kw: -3 can be drawn; permitted: 0 to 1e\+06"),
        ("tilt_deg", {"min": 0, "max": 91}, r"population.tilt_deg: 91 can be drawn; permitted: 0 to 90"),
        ("load_profiles", {"a": -1}, r"population.load_profiles.a = -1: permitted from 0 up"),
        ("load_profiles", {"a": 0}, r"population.load_profiles: permitted: at least one weight above 0"),
        ("count", 0, r"population.count = 0: permitted: a whole number from 1 to 100000"),
        ("soc_min", 0.95, r"population.soc_min = 0.95: permitted 0 to soc_max = 0.9"),
    ],
)
def test_impossible_distributions_are_told(path: str, value: object, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        load("village").with_(**{f"population.{path}": value})


def test_homes_and_population_are_one_or_the_other() -> None:
    village = load("village")
    with pytest.raises(ScenarioError, match="homes: given beside population; permitted: one of both"):
        village.with_(homes=[{"id": "a"}], population=village.population)
