"""The documentation names every HTTP route, query parameter, metric and environment variable."""

from __future__ import annotations

import re
from collections.abc import Iterator

from support.doc_pages import ROOT
from support.public_names import Route, environment_variables, metrics, openapi, routes

METHODS = "GET|HEAD|POST|PUT|PATCH|DELETE"


def page(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def codes(text: str) -> set[str]:
    """Everything set as code in a line, outside of fenced blocks."""
    return set(re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)))


def documented_routes() -> Iterator[Route]:
    """Routes in the first column of the tables of docs/http.md; a path without a method has the method before it."""
    for row in re.findall(r"^\| (`[^|]*) \|", page("http.md"), re.MULTILINE):
        method = ""
        for code in re.findall(r"`([^`]+)`", row):
            *named, path = code.split()
            method = named[0] if named and re.fullmatch(METHODS, named[0]) else method
            if path.startswith("/"):
                yield Route(method, path)


def test_every_route_is_documented_and_no_other() -> None:
    assert len(routes()) > 15
    served = {*routes(), Route("GET", "/openapi.json")}
    assert set(documented_routes()) == served


def test_every_query_parameter_is_documented() -> None:
    names = {
        parameter["name"]
        for methods in openapi()["paths"].values()
        for operation in methods.values()
        for parameter in operation.get("parameters", ())
        if parameter["in"] == "query"
    }
    words = {word for code in codes(page("http.md")) for word in re.findall(r"\w+", code)}
    assert names
    assert sorted(names - words) == []


def test_every_metric_is_documented() -> None:
    names = {f"{metric.name}_total" if metric.type == "counter" else metric.name for metric in metrics()}
    assert len(names) > 20
    assert sorted(names - codes(page("operating.md"))) == []


def test_no_metric_is_documented_that_does_not_exist() -> None:
    (table,) = re.findall(r"^\| metric \| meaning \|$.*?^$", page("operating.md"), re.MULTILINE | re.DOTALL)
    names = {f"{metric.name}_total" if metric.type == "counter" else metric.name for metric in metrics()}
    assert {code for code in codes(table) if code.startswith("zengrid_")} == names


def test_every_environment_variable_is_documented_on_the_page_of_operators() -> None:
    names = environment_variables()
    assert len(names) > 10
    words = {word for code in codes(page("operating.md")) for word in re.findall(r"\w+", code)}
    assert sorted(names - words) == []
