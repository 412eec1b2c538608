"""Facilities run in their order, between their limits, and what they cannot do is reported."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.random_slots import facilities
from zengrid.core.dispatch import dispatch, facility_cost
from zengrid.core.params import Facilities, Homes, MarketParams

HOME = Homes.of(6.0)
PAPER = Facilities.of(p_max_kw=[20.0, 50.0], cost_b=[0.03, 0.33], cost_a=[0.0, 0.012], p_min_kw=[5.0, 0.0])


@given(facilities(), st.floats(-50.0, 200.0))
def test_produced_energy_balances(plant: Facilities, net_kw: float) -> None:
    facility_kw, curtailed_kw, unserved_kw = dispatch(np.asarray(net_kw), MarketParams(HOME, plant, 1.0))
    assert facility_kw.sum() == pytest.approx(net_kw + curtailed_kw - unserved_kw, abs=1e-10)
    assert np.all((plant.p_min_kw <= facility_kw) & (facility_kw <= plant.p_max_kw))
    assert curtailed_kw == max(plant.p_min_kw[0] - net_kw, 0.0)
    assert unserved_kw == pytest.approx(max(net_kw - plant.p_max_kw.sum(), 0.0), abs=1e-10)


@given(facilities(), st.floats(-50.0, 200.0))
def test_a_facility_runs_only_when_those_before_it_are_full(plant: Facilities, net_kw: float) -> None:
    facility_kw, _, unserved_kw = dispatch(np.asarray(net_kw), MarketParams(HOME, plant, 1.0))
    for later in range(1, plant.count):
        if facility_kw[later] > 0.0:
            assert np.array_equal(facility_kw[:later], plant.p_max_kw[:later])
    if unserved_kw > 0.0:
        assert np.array_equal(facility_kw, plant.p_max_kw)


@pytest.mark.parametrize(
    ("net_kw", "facility_kw", "curtailed_kw", "unserved_kw"),
    [
        (-3.0, [5.0, 0.0], 8.0, 0.0),
        (0.0, [5.0, 0.0], 5.0, 0.0),
        (5.0, [5.0, 0.0], 0.0, 0.0),
        (12.5, [12.5, 0.0], 0.0, 0.0),
        (20.0, [20.0, 0.0], 0.0, 0.0),
        (33.0, [20.0, 13.0], 0.0, 0.0),
        (70.0, [20.0, 50.0], 0.0, 0.0),
        (72.0, [20.0, 50.0], 0.0, 2.0),
    ],
)
def test_the_papers_facilities_by_hand(
    net_kw: float, facility_kw: list[float], curtailed_kw: float, unserved_kw: float
) -> None:
    produced, surplus, shortage = dispatch(np.asarray(net_kw), MarketParams(HOME, PAPER, 1.0))
    assert produced.tolist() == facility_kw
    assert surplus == curtailed_kw
    assert shortage == unserved_kw


def test_cost_is_quadratic_in_power_and_linear_in_time() -> None:
    plant = Facilities.of(p_max_kw=[20.0, 50.0], cost_b=[0.03, 0.33], cost_a=[0.0, 0.012], cost_c=[0.5, 0.0])
    cost = facility_cost(np.array([[20.0, 10.0], [0.0, 0.0]]), MarketParams(HOME, plant, dt_h=0.25))
    np.testing.assert_allclose(cost, np.array([[0.6 + 0.5, 3.3 + 1.2], [0.5, 0.0]]) * 0.25, rtol=1e-14)
