"""An agent sees what the paper lets it see, and nothing of another home."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

from support.random_slots import Slot, slots
from zengrid.core.observe import (
    ObservationKind,
    grid_features,
    observe_grid,
    observe_prosumers,
    prosumer_features,
    time_features,
)

SOC, PV, LOAD = np.array([0.1, 0.5, 0.9]), np.array([1.0, 2.0, 3.0]), np.array([0.4, 0.5, 0.6])
COST, PAYMENT = np.array([0.6, 3.3]), np.array([0.01, 0.02, 0.03])
NOON = time_features(12, 1.0)


def test_a_prosumer_sees_its_own_home_and_the_price() -> None:
    seen = observe_prosumers("paper", SOC, PV, LOAD, 0.07, 0.095, NOON)
    assert prosumer_features("paper") == ("soc", "pv_kw", "load_kw", "buy_price")
    assert seen.tolist() == [[0.1, 1.0, 0.4, 0.07], [0.5, 2.0, 0.5, 0.07], [0.9, 3.0, 0.6, 0.07]]


def test_public_adds_what_every_customer_knows() -> None:
    seen = observe_prosumers("public", SOC, PV, LOAD, 0.07, 0.095, NOON)
    assert prosumer_features("public")[4:] == ("time_sin", "time_cos", "sell_price")
    assert np.array_equal(seen[:, :4], observe_prosumers("paper", SOC, PV, LOAD, 0.07, 0.095, NOON))
    assert seen[:, 4:].tolist() == [[*NOON, 0.095]] * 3


@given(slots())
def test_no_home_sees_another(slot: Slot) -> None:
    soc, action, exogenous, _ = slot
    pv_kw, load_kw = exogenous.pv_kw, exogenous.load_kw
    seen = observe_prosumers("public", soc, pv_kw, load_kw, action.buy_price, exogenous.sell_price, NOON)
    others = np.arange(soc.size) > 0
    changed = observe_prosumers(
        "public",
        np.where(others, soc / 2, soc),
        np.where(others, pv_kw + 1, pv_kw),
        np.where(others, load_kw + 1, load_kw),
        action.buy_price,
        exogenous.sell_price,
        NOON,
    )
    assert np.array_equal(seen[0], changed[0])


def test_the_grid_sees_costs_payments_and_demand() -> None:
    seen = observe_grid("paper", COST, PAYMENT, np.array(21.0), np.array(0.095), NOON)
    assert grid_features("paper", 2, 3) == (
        "facility_cost_1", "facility_cost_2", "payment_1", "payment_2", "payment_3", "demand_kw",
    )  # fmt: skip
    assert seen.tolist() == [0.6, 3.3, 0.01, 0.02, 0.03, 21.0]


def test_the_public_grid_observation_does_not_grow_with_the_homes() -> None:
    seen = observe_grid("public", COST, PAYMENT, np.array(21.0), np.array(0.095), NOON)
    assert grid_features("public", 2, 3) == (
        "facility_cost_1", "facility_cost_2", "payments", "homes", "demand_kw", "time_sin", "time_cos", "sell_price",
    )  # fmt: skip
    assert seen.tolist() == pytest.approx([0.6, 3.3, 0.06, 3, 21.0, *NOON, 0.095], rel=1e-15)
    assert grid_features("public", 2, 300) == grid_features("public", 2, 3)


@pytest.mark.parametrize("kind", ["paper", "public"])
@pytest.mark.parametrize("lead", [(), (4,), (2, 5)])
def test_every_feature_has_a_name(kind: ObservationKind, lead: tuple[int, ...]) -> None:
    home, price = np.ones((*lead, 3)), np.ones(lead)
    seen = observe_prosumers(kind, home, home, home, price, price, NOON)
    assert seen.shape == (*lead, 3, len(prosumer_features(kind)))
    grid = observe_grid(kind, np.ones((*lead, 2)), home, price, price, NOON)
    assert grid.shape == (*lead, len(grid_features(kind, 2, 3)))


@pytest.mark.parametrize(
    ("slot", "dt_h", "hour"), [(0, 1.0, 0), (6, 1.0, 6), (24, 0.25, 6), (18, 1.0, 18), (48, 1.0, 0)]
)
def test_time_of_day_does_not_depend_on_the_slot_length(slot: int, dt_h: float, hour: int) -> None:
    angle = 2 * math.pi * hour / 24
    assert time_features(slot, dt_h) == pytest.approx((math.sin(angle), math.cos(angle)), abs=1e-12)
