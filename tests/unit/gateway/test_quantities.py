"""Named quantities become rows in the order of a policy's features."""

from __future__ import annotations

import math

import pytest

from zengrid.core.observe import prosumer_features, time_features
from zengrid_gateway.quantities import NUMBERS, QuantityError, observations

NOW = {"soc": 0.5, "pv_kw": 1.0, "load_kw": 2.0, "buy_price": 0.05, "sell_price": 0.09, "hour": 6.0}


def test_what_is_not_named_is_as_it_is_now() -> None:
    (row,) = observations(prosumer_features("paper"), {"pv_kw": 3}, NOW)
    assert row == (0.5, 3.0, 2.0, 0.05)


def test_the_hour_becomes_sine_and_cosine() -> None:
    rows = observations(prosumer_features("public"), {"hour": [0, 6, 13]}, NOW)
    for row, slot in zip(rows, (0, 6, 13), strict=True):
        assert row[4:6] == pytest.approx(time_features(slot, 1.0))
    assert all(math.isclose(row[6], 0.09) for row in rows)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ({"colour": 1.0}, "colour"),
        ({"soc": [0.1, 0.2], "pv_kw": [1.0, 2.0, 3.0]}, "soc"),
        ({"soc": [0.1] * (NUMBERS // 7 + 1)}, "soc"),
    ],
)
def test_unusable_quantities_are_refused(given: dict[str, float | list[float]], name: str) -> None:
    with pytest.raises(QuantityError) as error:
        observations(prosumer_features("public"), given, NOW)
    assert error.value.name == name


def test_what_is_not_known_must_be_given() -> None:
    with pytest.raises(QuantityError, match="give one"):
        observations(("soc",), {}, {})
