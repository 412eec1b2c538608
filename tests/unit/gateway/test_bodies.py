"""Bodies are counted before they are parsed, and parsed as strictly as JSON is defined."""

from __future__ import annotations

import json

import pytest

from zengrid_gateway.bodies import MAX_FIELDS, MAX_VALUES, parse
from zengrid_gateway.problems import Problem


def test_a_body() -> None:
    body = {"quantities": {"soc": [0.1, 0.5], "hour": 13}, "home": None}
    assert parse(json.dumps(body).encode()) == body


@pytest.mark.parametrize(
    ("body", "says"),
    [
        (b"{" + b",".join(b'"%d":1' % i for i in range(MAX_FIELDS + 1)) + b"}", f"body = {MAX_FIELDS + 1} fields"),
        (b"[" + b",".join([b"1"] * MAX_VALUES) + b"]", f"body = {MAX_VALUES + 1} values"),
        (b"[" * 2**21, f"body = {2**21 + 1} values"),
        (b"[" + b",".join([b"{}"] * MAX_VALUES) + b"]", "values"),
    ],
)
def test_what_is_too_much_is_not_parsed(body: bytes, says: str) -> None:
    with pytest.raises(Problem) as refused:
        parse(body)
    assert refused.value.kind == "too-large"
    assert says in refused.value.detail


@pytest.mark.parametrize("body", [b'{"a":1,' * (MAX_FIELDS // 2), b"[" + b",".join([b"1"] * (MAX_VALUES - 1)) + b"]"])
def test_what_is_just_not_too_much(body: bytes) -> None:
    try:
        parse(body)
    except Problem as problem:
        assert problem.kind == "invalid"  # noqa: PT017


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[NaN]",
        b"[-Infinity]",
        b"[" * 1000 + b"]" * 1000,
        b'"\xff"',
        b'"\\ud800"',
        b'{"\\ud800": 1}',
        "{}".encode("utf-16"),
        b"[" + b"1" * 10_000 + b"]",
        b'"' + b"\xff" * 10**6 + b'"',
    ],
)
def test_what_is_no_json(body: bytes) -> None:
    with pytest.raises(Problem, match="JSON in UTF-8") as refused:
        parse(body)
    assert refused.value.kind == "invalid"
    assert refused.value.errors[0].field == "body"
    assert len(refused.value.response().body) < 4000
