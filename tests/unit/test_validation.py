"""Error messages name the field by its path, and show its value in one short line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from zengrid.validation import VALUE_MAX, field_name, first_error, short_value


class Inner(BaseModel):
    pv_kw: float


class Outer(BaseModel):
    homes: list[Inner]


def test_a_field_inside_a_list_is_named_by_its_path() -> None:
    assert field_name(("homes", 0, "pv_kw")) == "homes.0.pv_kw"


@given(st.recursive(st.text(max_size=200) | st.integers() | st.none(), st.lists))
def test_a_value_is_shown_in_one_short_line(value: object) -> None:
    text = short_value(value)
    assert 0 < len(text) <= VALUE_MAX
    assert "\n" not in text


def test_a_short_value_is_shown_whole() -> None:
    assert short_value("a" * (VALUE_MAX - 2)) == repr("a" * (VALUE_MAX - 2))


@pytest.mark.parametrize(
    ("given_", "says"),
    [
        ({"homes": [{"pv_kw": "x"}, {"pv_kw": "y"}]}, "homes.0.pv_kw = 'x': Input should be a valid number"),
        ({}, "homes = {}: Field required"),
        (7, "message = 7: Input should be a valid dictionary"),
    ],
)
def test_the_first_error_becomes_one_line(given_: object, says: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate(given_)
    assert first_error(caught.value).startswith(says)
