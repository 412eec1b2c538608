"""Markets are built from plain numbers, and refuse what cannot exist."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from zengrid.core.params import Facilities, Homes, MarketParams

PLANT = Facilities.of(p_max_kw=[20.0, 50.0], cost_b=[0.03, 0.33], p_min_kw=[5.0, 0.0])


def test_numbers_are_spread_over_the_homes() -> None:
    homes = Homes.of([6.0, 12.0, 8.0], soc_min=[0.1, 0.2, 0.3])
    assert homes.count == 3
    assert homes.charge_max_kw.tolist() == [2.0, 2.0, 2.0]
    assert homes.soc_min.tolist() == [0.1, 0.2, 0.3]
    assert all(getattr(homes, field.name).shape == (3,) for field in dataclasses.fields(homes))


def test_homes_leave_and_join_in_order() -> None:
    homes = Homes.of([6.0, 12.0, 8.0], injection_max_kw=[1.0, 2.0, 3.0])
    assert homes.take([2, 0]).capacity_kwh.tolist() == [8.0, 6.0]
    joined = homes.take([1]).join(Homes.of([4.0, 5.0]))
    assert joined.capacity_kwh.tolist() == [12.0, 4.0, 5.0]
    assert joined.injection_max_kw.tolist() == [2.0, 10.0, 10.0]


def test_a_market_changes_its_homes_and_keeps_the_rest() -> None:
    market = MarketParams(Homes.of([6.0, 12.0]), PLANT, dt_h=0.25, value_of_lost_load=3.0)
    other = market.with_homes(Homes.of([4.0]))
    assert other.homes.count == 1
    assert (other.facilities, other.dt_h, other.value_of_lost_load) == (PLANT, 0.25, 3.0)


def test_resizing_batteries_keeps_their_state_of_charge() -> None:
    homes = Homes.of([6.0, 12.0], soc_initial=[0.5, 0.3])
    resized = MarketParams(homes, PLANT, dt_h=1.0).with_capacity(25.0).homes
    assert resized.capacity_kwh.tolist() == [25.0, 25.0]
    assert resized.soc_initial.tolist() == [0.5, 0.3]
    assert homes.capacity_kwh.tolist() == [6.0, 12.0]


@pytest.mark.parametrize("dt_h", [0.0, -1.0, float("nan")])
def test_a_slot_has_a_length(dt_h: float) -> None:
    with pytest.raises(ValueError, match=r"dt_h = .*longer than 0 h"):
        MarketParams(Homes.of(6.0), PLANT, dt_h)


def test_a_market_has_a_facility() -> None:
    with pytest.raises(ValueError, match="at least one generation facility"):
        MarketParams(Homes.of(6.0), Facilities.of(np.zeros(0), np.zeros(0)), 1.0)


def test_only_the_first_facility_has_a_minimum() -> None:
    with pytest.raises(ValueError, match="only the first facility can have a minimum"):
        MarketParams(Homes.of(6.0), Facilities.of([20.0, 50.0], 0.1, p_min_kw=[0.0, 5.0]), 1.0)


def test_a_battery_does_not_make_energy() -> None:
    with pytest.raises(ValueError, match=r"charge_efficiency = \[1.1\].*at most 1"):
        MarketParams(Homes.of(6.0, charge_efficiency=1.1), PLANT, 1.0)
