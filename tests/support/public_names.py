"""All names that users meet: fields of messages and HTTP answers, journal columns, routes, metrics, settings."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import prometheus_client
from prometheus_client.core import Metric

from message_schemas import MESSAGES
from support.doc_pages import ROOT
from support.sample_status import status
from zengrid.journal.slot_columns import COLUMNS
from zengrid.journal.totals import MARKET_TOTALS
from zengrid.scenario import Scenario
from zengrid_gateway.access import Access
from zengrid_gateway.app import create_app
from zengrid_gateway.metrics import MarketCollector, Metrics
from zengrid_gateway.settings import Settings
from zengrid_gateway.tokens import Tokens

STANDARD_METRICS = ("process_", "python_")
"""Prefixes of the metrics that every Prometheus client has."""


class Route(NamedTuple):
    """One operation of the HTTP API."""

    method: str
    path: str


@cache
def openapi() -> dict[str, Any]:
    """The gateway's OpenAPI document."""
    return create_app(Settings(), Access("nothing", Tokens({}))).openapi()


def routes() -> list[Route]:
    """Every operation of the gateway."""
    return [Route(method.upper(), path) for path, methods in openapi()["paths"].items() for method in methods]


def message_fields() -> set[str]:
    """Fields of all messages on Zenoh, with those of their parts."""
    return {name for kind in MESSAGES for name in _properties(kind.model_json_schema())}


def http_names() -> set[str]:
    """Fields of all HTTP bodies, and query parameters."""
    document = openapi()
    parameters = [
        parameter
        for methods in document["paths"].values()
        for operation in methods.values()
        for parameter in operation.get("parameters", ())
    ]
    fields = {name for schema in document["components"]["schemas"].values() for name in schema.get("properties", ())}
    return fields | {parameter["name"] for parameter in parameters if parameter["in"] == "query"}


def journal_names() -> set[str]:
    """Columns of the journal's slots, and its totals."""
    return {*COLUMNS, *MARKET_TOTALS}


def scenario_fields() -> set[str]:
    """Fields of a scenario file; ``docs/scenarios.md`` documents each of them."""
    return set(_properties(Scenario.model_json_schema(by_alias=True)))


def metrics() -> list[Metric]:
    """Every metric of the gateway, from a market in which each has a value."""
    market, own = _registries()
    return [
        metric
        for registry in (market, own)
        for metric in registry.collect()
        if not metric.name.startswith(STANDARD_METRICS)
    ]


def series_names() -> set[str]:
    """Names of all time series that ``/metrics`` can have."""
    text = "".join(prometheus_client.generate_latest(registry).decode() for registry in _registries())
    return set(re.findall(r"^(\w+)", text, flags=re.MULTILINE)) | set(re.findall(r"# TYPE (\w+)", text))


def _registries() -> tuple[prometheus_client.CollectorRegistry, prometheus_client.CollectorRegistry]:
    """The market's metrics, and the gateway's own."""
    feed = SimpleNamespace(present=True, latest=object(), latest_at=0.0)
    link = cast("Any", SimpleNamespace(feed=feed, status=status(refused={"late": 1})))
    frames = cast("Any", SimpleNamespace(clients=0))
    market = prometheus_client.CollectorRegistry()
    market.register(MarketCollector(link, frames))
    metrics = Metrics(link, frames)
    metrics.answered("/v1/price", 200, 0.001)
    return market, metrics._registry


def environment_variables() -> set[str]:
    """Every ``ZENGRID_...`` variable that the code or a deployment reads."""
    sources = [
        *ROOT.glob("shared/**/*.py"),
        *ROOT.glob("services/**/*.py"),
        *ROOT.glob("deploy/**/*"),
        *ROOT.glob("docker-compose*.yml"),
    ]
    return {
        name
        for path in sources
        if path.is_file()
        for name in re.findall(r"\bZENGRID_[A-Z_]+\b", path.read_text(encoding="utf-8", errors="ignore"))
    }


def gateway_settings() -> list[str]:
    """Fields of the gateway's settings."""
    return [field.name for field in dataclasses.fields(Settings)]


def _properties(schema: dict[str, Any]) -> Iterator[str]:
    for part in (schema, *schema.get("$defs", {}).values()):
        yield from part.get("properties", ())
