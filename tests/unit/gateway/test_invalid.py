"""Errors are explained field by field, and however many there are, the explanation is short and made in linear time."""

from __future__ import annotations

from typing import Any, ClassVar

import pytest
from pydantic import TypeAdapter, ValidationError

from zengrid_gateway.invalid import ALLOWED, EXPLAINED, SHOWN, FieldError, Place, explain, shown, told

MANY = 50_000


def errors(kind: Any, body: object) -> list[Any]:
    """What FastAPI makes of pydantic's errors."""
    try:
        TypeAdapter(kind).validate_python(body)
    except ValidationError as error:
        return [{**each, "loc": ("body", *each["loc"])} for each in error.errors(include_url=False)]
    raise AssertionError(f"{body!r} is valid")


def fields(kind: Any, body: object) -> dict[str, FieldError]:
    explained, more = explain(errors(kind, body), body, lambda _: ["a", "b"])
    assert more == 0
    return {error.field: error for error in explained}


def test_what_is_wrong_inside_says_more_than_what_is_wrong_around_it() -> None:
    found = fields(dict[str, int | list[int]], {"x": [1, "two"], "y": "three"})
    assert list(found) == ["body.x.1", "body.y"]
    assert found["body.x.1"].value == "two"
    assert found["body.y"].allowed.count("; or: ") == 1


def test_an_alternative_is_no_index() -> None:
    # The name of an alternative must not be looked for among the values of a list.
    found = fields(dict[str, int | dict[str, int]], {"x": [1, 2]})
    assert list(found) == ["body.x"]


@pytest.mark.parametrize("value", ["x", ["x"]])
def test_many_errors(value: object) -> None:
    body = {f"f{i}": value for i in range(MANY // 2)}
    found = errors(dict[str, int | list[int]], body)
    assert len(found) == MANY
    explained, more = explain(found, body, lambda _: [])
    assert [error.field for error in explained] == [
        f"body.f{i}" if value == "x" else f"body.f{i}.0" for i in range(EXPLAINED)
    ]
    assert more == MANY // 2 - EXPLAINED


def test_many_errors_in_one_list() -> None:
    body = ["x"] * MANY
    explained, more = explain(errors(list[int], body), body, lambda _: [])
    assert (len(explained), more) == (EXPLAINED, MANY - EXPLAINED)


def test_many_errors_of_one_field() -> None:
    same = [{"type": "int_type", "loc": ("body", f"alternative{i}"), "msg": f"no {i}", "input": 1} for i in range(MANY)]
    (error,), more = explain(same, {}, lambda _: [])
    assert (error.field, more) == ("body", 0)
    assert len(error.allowed) <= ALLOWED


class Counted(str):
    """A name that counts how often it is looked at."""

    looks: ClassVar[int] = 0

    def __eq__(self, other: object) -> bool:
        Counted.looks += 1
        return str.__eq__(self, other)

    def __hash__(self) -> int:
        Counted.looks += 1
        return str.__hash__(self)


def looks(count: int) -> int:
    """How often the names of so many unknown fields are looked at, and those of known ones asked for."""
    names = [Counted(f"f{i}") for i in range(count)]
    unknown = [{"type": "extra_forbidden", "loc": ("body", name), "msg": "no", "input": names} for name in names]
    asked: list[Place] = []

    def known(place: Place) -> list[str]:
        asked.append(place)
        return ["a"]

    body = dict.fromkeys(names)
    Counted.looks = 0
    _, more = explain(unknown, body, known)
    assert more == count - EXPLAINED
    assert len(asked) == EXPLAINED
    return Counted.looks


def test_the_time_grows_with_the_number_of_errors_alone() -> None:
    assert looks(10_000) < 2.5 * looks(5_000)


def test_short_values_are_shown_as_they_are() -> None:
    for value in (None, True, 3, -1.5, "p1"):
        assert shown(value) is value
    assert shown([1, "a", {"b": None}]) == '[1, "a", {"b": null}]'
    assert shown(float("inf")) == "inf"


class Untold(list[int]):
    """A list that must not be read to its end."""

    def __iter__(self) -> Any:
        yield from range(1000)
        raise AssertionError("the whole list was read")


@pytest.mark.parametrize(
    "value", ["x" * 10**6, 10**4000, ["x" * 10**6], {"x" * 10**6: 1}, Untold([1]), [[[[]]]] * 1000]
)
def test_long_values_are_cut(value: object) -> None:
    text = shown(value)
    assert isinstance(text, str)
    assert len(text) == SHOWN
    assert text.endswith("...")


def test_everything_in_an_explanation_is_short() -> None:
    error = FieldError(field="f" * 10**6, value="v" * 10**6, allowed="a" * 10**6)
    assert len(error.model_dump_json()) < 2 * SHOWN + ALLOWED + 100


def test_what_the_market_names() -> None:
    (error,) = told("home p4: capacity_kwh = -1: permitted 0 to 1e6", inside="body.")
    assert (error.field, error.value, error.allowed) == ("body.capacity_kwh", "-1", "permitted 0 to 1e6")
    assert told("the market is over") == []


@pytest.mark.parametrize("text", ["a" * 10**6, "a = " + ": " * 10**6, "a " * 10**6, "a = " * 10**6, "a.a: " * 10**6])
def test_long_texts_of_the_market(text: str) -> None:
    assert sum(len(error.model_dump_json()) for error in told(text)) < 2 * SHOWN + ALLOWED + 100
