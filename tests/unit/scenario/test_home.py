"""A home as joining agents describe it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from zengrid.core.params import HOME_FIELDS, Homes
from zengrid.scenario import BatterySpec, HomeSpec, homes_params
from zengrid.scenario.home_spec import SMALLEST, home_columns
from zengrid.wire.queries import HomeLimits


def test_a_home_is_complete_with_pv_and_battery() -> None:
    home = HomeSpec.model_validate({"id": "p4", "pv_kw": 5, "battery": {"capacity_kwh": 10}})
    assert (home.battery.charge_max_kw, home.battery.soc_min, home.battery.soc_max) == (2.0, 0.1, 0.9)
    assert home.battery.soc_initial == 0.5
    assert home.injection_max_kw == 10.0
    assert HomeSpec.model_validate_json(home.model_dump_json()) == home


@pytest.mark.parametrize("name", ["", "P1", "-p", "p 1", "p/1", "p" * 64, "p*", "@p"])
def test_an_id_that_a_key_cannot_hold_is_refused(name: str) -> None:
    with pytest.raises(ValidationError):
        HomeSpec(id=name)


@pytest.mark.parametrize(
    "battery",
    [
        {"capacity_kwh": -1},
        {"capacity_kwh": float("nan")},
        {"capacity_kwh": float("inf")},
        {"capacity_kwh": 1e-320},
        {"charge_max_kw": 1e-9},
        {"discharge_max_kw": 5e-324},
        {"charge_efficiency": 1e-300},
        {"soc_min": 0.9, "soc_max": 0.1},
        {"charge_efficiency": 0.0},
        {"discharge_efficiency": 1.1},
        {"capacity_kwh": 10, "initial_kwh": 9.5},
        {"capacity_kwh": 10, "size": 3},
    ],
)
def test_impossible_batteries_are_refused(battery: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        BatterySpec.model_validate(battery)


@given(st.just(0.0) | st.floats(SMALLEST, 100), st.floats(0, 1), st.floats(0, 1))
def test_the_first_state_of_charge_is_permitted(capacity: float, one: float, other: float) -> None:
    low, high = sorted((one, other))
    assert low <= BatterySpec(capacity_kwh=capacity, soc_min=low, soc_max=high).soc_initial <= high


def test_a_home_is_the_same_in_the_core_in_its_scenario_and_in_the_join_reply() -> None:
    battery = BatterySpec(
        capacity_kwh=10.0, charge_max_kw=3.0, discharge_max_kw=4.0, soc_min=0.15, soc_max=0.85,
        charge_efficiency=0.95, discharge_efficiency=0.93, initial_kwh=7.0,
    )  # fmt: skip
    home = HomeSpec(id="p4", pv_kw=5.0, battery=battery, injection_max_kw=11.0)
    values = (10.0, 3.0, 4.0, 0.15, 0.85, 0.95, 0.93, 11.0, 0.7)
    assert home_columns(home) == dict(zip(HOME_FIELDS, values, strict=True))
    limits = HomeLimits.of(home)
    assert limits.model_dump(exclude={"v", "id", "pv_kw"}) == home_columns(home)
    assert tuple(HomeLimits.model_fields)[3:] == HOME_FIELDS
    for homes in (homes_params([home, home]), Homes.from_rows([limits, limits])):
        assert {name: getattr(homes, name).tolist() for name in HOME_FIELDS} == {
            name: [value, value] for name, value in home_columns(home).items()
        }


def test_arrays_keep_the_order_of_homes() -> None:
    homes = [HomeSpec(id=f"h{i}", battery=BatterySpec(capacity_kwh=i, charge_max_kw=10 + i)) for i in range(1, 4)]
    params = homes_params(homes)
    np.testing.assert_array_equal(params.capacity_kwh, [1, 2, 3])
    np.testing.assert_array_equal(params.charge_max_kw, [11, 12, 13])
    assert all(array.flags.c_contiguous for array in (params.capacity_kwh, params.soc_initial))
    assert homes_params([]).count == 0
