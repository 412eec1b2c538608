"""docs/glossary.md explains every name that messages, HTTP answers, the journal and metrics use."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from support.doc_pages import ROOT
from support.public_names import http_names, journal_names, message_fields, metrics, scenario_fields

PAGE = "docs/glossary.md"
BASELINE = "baseline_"
PERCENTILES = ("_p50_ms", "_p99_ms")
METRIC_UNITS = {"_per_second": "_per_s", "_seconds": "_s"}
"""A metric's unit, and the same in the names of fields."""


def explained() -> set[str]:
    """Names set as code in the first two columns of the glossary's tables."""
    rows = re.findall(r"^\| .*\|$", (ROOT / PAGE).read_text(encoding="utf-8"), re.MULTILINE)
    terms = [" ".join(row.split("|")[1:-2]) for row in rows]
    return set(re.findall(r"`([a-z][a-z0-9_]*)`", " ".join(terms)))


def is_explained(name: str, terms: set[str]) -> bool:
    """Whether the glossary has a name, or the name from which its rules derive it."""
    if name in terms:
        return True
    if name.startswith(BASELINE):
        return is_explained(name.removeprefix(BASELINE), terms)
    return any(name.endswith(suffix) and name.removesuffix(suffix) in terms for suffix in PERCENTILES)


def field_of(metric: str) -> str:
    """The field that a metric reports."""
    name = metric.removeprefix("zengrid_")
    return next((name.removesuffix(unit) + own for unit, own in METRIC_UNITS.items() if name.endswith(unit)), name)


TERMS = explained()


@pytest.mark.parametrize("names", [message_fields, http_names, journal_names], ids=["messages", "HTTP", "journal"])
def test_every_field_is_explained(names: Callable[[], set[str]]) -> None:
    assert sorted(name for name in names() - scenario_fields() if not is_explained(name, TERMS)) == []


def test_every_metric_is_explained_or_named_after_a_field() -> None:
    names = {f"{metric.name}_total" if metric.type == "counter" else metric.name for metric in metrics()}
    assert len(names) > 20
    unexplained = [
        name for name in names if name not in TERMS and not is_explained(field_of(name.removesuffix("_total")), TERMS)
    ]
    assert sorted(unexplained) == []


def test_the_rules_need_the_name_they_derive_from() -> None:
    assert is_explained("baseline_bill", {"bill"})
    assert is_explained("price_p50_ms", {"price"})
    assert not is_explained("baseline_bill", {"bills"})
    assert not is_explained("price_p50_s", {"price"})
    assert field_of("zengrid_slots_per_second") == "slots_per_s"
    assert field_of("zengrid_demand_kw") == "demand_kw"
