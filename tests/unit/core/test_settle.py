"""Energy and money balance in every settled slot, whoever does whatever."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.random_slots import Slot, slots
from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous, Settlement

Floats = NDArray[np.float64]


def close(actual: Floats, expected: Floats) -> None:
    np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-12)


@given(slots())
def test_energy_balances_at_every_meter(slot: Slot) -> None:
    soc, _, exogenous, _ = slot
    settled = settle(*slot)
    close(
        exogenous.pv_kw - exogenous.load_kw - settled.battery_kw,
        settled.injection_kw + settled.home_curtailed_kw - settled.home_unserved_kw,
    )
    close(settled.home_export_kw - settled.home_import_kw, settled.injection_kw)
    assert settled.soc.shape == soc.shape


@given(slots())
def test_energy_balances_on_the_bus(slot: Slot) -> None:
    settled = settle(*slot)
    close(settled.demand_kw, slot.exogenous.consumer_kw.sum() + settled.home_import_kw.sum())
    close(
        settled.facility_kw.sum() + settled.home_export_kw.sum() + settled.unserved_kw,
        settled.demand_kw + settled.curtailed_kw,
    )


@given(slots())
def test_money_balances(slot: Slot) -> None:
    settled = settle(*slot)
    close(settled.bill.sum() + settled.consumer_payment, settled.revenue - settled.payment.sum())
    close(
        settled.profit,
        settled.revenue - settled.facility_cost.sum() - settled.payment.sum() - settled.lost_load_cost,
    )


@given(slots())
def test_money_follows_energy(slot: Slot) -> None:
    _, action, exogenous, market = slot
    settled = settle(*slot)
    close(settled.payment, settled.home_export_kw * action.buy_price * market.dt_h)
    close(settled.bill, settled.home_import_kw * exogenous.sell_price * market.dt_h - settled.payment)
    close(settled.consumer_payment, exogenous.consumer_kw.sum() * exogenous.sell_price * market.dt_h)
    close(settled.revenue, settled.demand_kw * exogenous.sell_price * market.dt_h)
    close(settled.lost_load_cost, settled.unserved_kw * market.value_of_lost_load * market.dt_h)


@given(slots(), st.integers(0, 2**32 - 1))
def test_permuting_homes_permutes_results(slot: Slot, seed: int) -> None:
    soc, action, exogenous, market = slot
    order = np.random.default_rng(seed).permutation(market.homes.count)
    settled = settle(*slot)
    permuted = settle(
        soc[order],
        Action(action.buy_price, action.battery_kw[order]),
        exogenous._replace(pv_kw=exogenous.pv_kw[order], load_kw=exogenous.load_kw[order]),
        market.with_homes(market.homes.take(order)),
    )
    by_home = {"soc", "battery_kw", "injection_kw", "home_export_kw", "home_import_kw", "payment", "bill"}
    by_home |= {"home_curtailed_kw", "home_unserved_kw"}
    for name, before, after in zip(Settlement._fields, settled, permuted, strict=True):
        if name in by_home:
            assert np.array_equal(before[order], after), name
        else:
            np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-12 * slot_size(slot), err_msg=name)


def slot_size(slot: Slot) -> float:
    """Largest sum of powers that can cancel in a market's total. [kW]"""
    _, _, exogenous, market = slot
    return float(exogenous.consumer_kw.sum() + market.homes.injection_max_kw.sum()) + 1.0


@given(slots())
def test_half_the_slot_twice_is_the_slot(slot: Slot) -> None:
    """With constant inputs, which takes commands that each battery can follow to the end of the slot."""
    soc, action, exogenous, market = slot
    whole = settle(*slot)
    steady = Action(action.buy_price, whole.battery_kw)
    half = MarketParams(market.homes, market.facilities, market.dt_h / 2, market.value_of_lost_load)
    first = settle(soc, steady, exogenous, half)
    second = settle(first.soc, steady, exogenous, half)
    for name in Settlement._fields:
        before, one, two = (getattr(settled, name) for settled in (whole, first, second))
        joined = two if name == "soc" else (one + two) / 2 if name.endswith("_kw") else one + two
        np.testing.assert_allclose(joined, before, rtol=1e-9, atol=1e-9, err_msg=name)


def test_a_shortage_is_charged_at_the_value_of_lost_load() -> None:
    market = MarketParams(Homes.of(0.0), Facilities.of(p_max_kw=10.0, cost_b=0.1), dt_h=0.5, value_of_lost_load=7.0)
    exogenous = Exogenous(np.zeros(1), np.array([4.0]), np.array([9.0]), np.array(0.2))
    settled = settle(np.array([0.5]), Action(np.array(0.05), np.zeros(1)), exogenous, market)
    assert settled.unserved_kw == 3.0
    assert settled.lost_load_cost == pytest.approx(3.0 * 7.0 * 0.5)
    assert settled.profit == pytest.approx(13.0 * 0.2 * 0.5 - 10.0 * 0.1 * 0.5 - 3.0 * 7.0 * 0.5)


def test_a_surplus_is_curtailed_and_still_paid_for() -> None:
    plant = Facilities.of(p_max_kw=20.0, cost_b=0.1, p_min_kw=5.0)
    exogenous = Exogenous(np.array([6.0]), np.zeros(1), np.array([2.0]), np.array(0.2))
    settled = settle(
        np.array([0.5]), Action(np.array(0.05), np.zeros(1)), exogenous, MarketParams(Homes.of(0.0), plant, dt_h=1.0)
    )
    assert settled.facility_kw.tolist() == [5.0]
    assert settled.curtailed_kw == 9.0
    assert settled.profit == pytest.approx(2.0 * 0.2 - 5.0 * 0.1 - 6.0 * 0.05)


def test_a_market_without_homes_settles_its_consumers() -> None:
    market = MarketParams(Homes.of(np.zeros(0)), Facilities.of(p_max_kw=10.0, cost_b=0.1), dt_h=1.0)
    none = np.zeros(0)
    settled = settle(none, Action(np.array(0.05), none), Exogenous(none, none, np.array([3.0]), np.array(0.2)), market)
    assert settled.bill.shape == (0,)
    assert settled.profit == pytest.approx(3.0 * 0.2 - 3.0 * 0.1)


def test_prices_may_be_plain_numbers() -> None:
    market = MarketParams(Homes.of([6.0, 6.0]), Facilities.of(p_max_kw=10.0, cost_b=0.1), dt_h=1.0)
    home = np.array([1.0, 2.0])
    plain = settle(home / 4, Action(0.05, home), Exogenous(home, home, home, 0.2), market)  # type: ignore[arg-type]
    arrays = settle(home / 4, Action(np.array(0.05), home), Exogenous(home, home, home, np.array(0.2)), market)
    assert all(np.array_equal(a, b) for a, b in zip(plain, arrays, strict=True))
