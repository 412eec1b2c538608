"""A battery keeps its limits and loses nothing it should keep; a meter keeps its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.random_slots import Slot, slots
from zengrid.core.home_physics import battery_step, meter
from zengrid.core.params import Facilities, Homes, MarketParams

PLANT = Facilities.of(p_max_kw=10.0, cost_b=0.1)


@given(slots())
def test_limits_hold_for_any_command(slot: Slot) -> None:
    homes = slot.market.homes
    battery_kw, soc = battery_step(slot.soc, slot.action.battery_kw, slot.market)
    assert np.all((homes.soc_min <= soc) & (soc <= homes.soc_max))
    assert np.all((-homes.discharge_max_kw <= battery_kw) & (battery_kw <= homes.charge_max_kw))


@given(slots())
def test_the_battery_follows_in_the_direction_of_its_command(slot: Slot) -> None:
    command_kw = slot.action.battery_kw
    battery_kw, _ = battery_step(slot.soc, command_kw, slot.market)
    assert np.all(battery_kw * command_kw >= 0.0)
    assert np.all(np.abs(battery_kw) <= np.abs(command_kw))


@given(slots())
def test_stored_energy_is_what_went_in_less_losses(slot: Slot) -> None:
    market = slot.market
    homes = market.homes
    battery_kw, soc = battery_step(slot.soc, slot.action.battery_kw, market)
    stored_kw = homes.charge_efficiency * np.maximum(battery_kw, 0.0)
    drawn_kw = np.maximum(-battery_kw, 0.0) / homes.discharge_efficiency
    np.testing.assert_allclose(
        homes.capacity_kwh * (soc - slot.soc), (stored_kw - drawn_kw) * market.dt_h, rtol=0, atol=1e-12
    )


@given(slots())
def test_a_home_without_battery_is_a_battery_that_does_nothing(slot: Slot) -> None:
    battery_kw, soc = battery_step(slot.soc, slot.action.battery_kw, slot.market.with_capacity(0.0))
    assert np.all(battery_kw == 0.0)
    assert np.array_equal(soc, slot.soc)


@pytest.mark.parametrize(
    ("soc", "command_kw", "battery_kw", "after"),
    [
        (0.5, 1.0, 1.0, 0.5 + 0.9 * 1.0 * 0.5 / 10),
        (0.5, -1.0, -1.0, 0.5 - 1.0 / 0.8 * 0.5 / 10),
        (0.5, 9.0, 2.0, 0.5 + 0.9 * 2.0 * 0.5 / 10),
        (0.5, -9.0, -3.0, 0.5 - 3.0 / 0.8 * 0.5 / 10),
        (0.87, 2.0, 0.03 * 10 / 0.9 / 0.5, 0.9),
        (0.12, -3.0, -0.02 * 10 * 0.8 / 0.5, 0.1),
        (0.9, 2.0, 0.0, 0.9),
        (0.1, -2.0, 0.0, 0.1),
    ],
)
def test_efficiencies_and_limits_by_hand(soc: float, command_kw: float, battery_kw: float, after: float) -> None:
    homes = Homes.of(10.0, charge_max_kw=2.0, discharge_max_kw=3.0, charge_efficiency=0.9, discharge_efficiency=0.8)
    power, end = battery_step(np.array([soc]), np.array([command_kw]), MarketParams(homes, PLANT, dt_h=0.5))
    assert power.item() == pytest.approx(battery_kw, abs=1e-12)
    assert end.item() == pytest.approx(after, abs=1e-12)


@given(slots(), st.integers(2, 12))
def test_the_slot_length_does_not_change_where_a_constant_command_ends(slot: Slot, parts: int) -> None:
    homes, dt_h = slot.market.homes, slot.market.dt_h
    battery_kw, whole = battery_step(slot.soc, slot.action.battery_kw, slot.market)
    short, soc, energy_kwh = MarketParams(homes, PLANT, dt_h / parts), slot.soc, np.zeros(homes.count)
    for _ in range(parts):
        power_kw, soc = battery_step(soc, slot.action.battery_kw, short)
        energy_kwh += power_kw * short.dt_h
    np.testing.assert_allclose(soc, whole, rtol=0, atol=1e-9)
    np.testing.assert_allclose(energy_kwh, battery_kw * dt_h, rtol=0, atol=1e-9)


@given(slots())
def test_the_meter_splits_without_loss(slot: Slot) -> None:
    wanted_kw = slot.exogenous.pv_kw - slot.exogenous.load_kw
    injection, export, import_, curtailed, unserved = meter(wanted_kw, slot.market)
    limit = slot.market.homes.injection_max_kw
    assert np.all((export >= 0.0) & (import_ >= 0.0) & (curtailed >= 0.0) & (unserved >= 0.0))
    assert np.all((export <= limit) & (import_ <= limit))
    assert np.all((export == 0.0) | (import_ == 0.0))
    assert np.array_equal(export - import_, injection)
    np.testing.assert_allclose(injection + curtailed - unserved, wanted_kw, rtol=0, atol=1e-14)
    assert np.all((curtailed == 0.0) | (injection == limit))
    assert np.all((unserved == 0.0) | (injection == -limit))


def test_the_meter_splits_power_as_computed_by_hand() -> None:
    homes = Homes.of([1.0] * 5, injection_max_kw=3.0)
    split = meter(np.array([5.0, 3.0, 0.0, -1.0, -4.0]), MarketParams(homes, PLANT, 1.0))
    assert [column.tolist() for column in split] == [
        [3.0, 3.0, 0.0, -1.0, -3.0],
        [3.0, 3.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 3.0],
        [2.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0],
    ]
