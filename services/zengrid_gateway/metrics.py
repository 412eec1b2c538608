"""Figures for Prometheus: the market's, and the gateway's own."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import accumulate
from typing import Annotated

import prometheus_client
from fastapi import APIRouter, Depends, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.requests import HTTPConnection

from zengrid.wire.queries import Histogram, Status
from zengrid_gateway.frames import Frames
from zengrid_gateway.link import MarketLink
from zengrid_gateway.problems import documented

AGENTS = 200
"""With more agents than this their counters are added up: a time series for each would burden whoever collects them."""
BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0)

router = APIRouter(tags=["operation"])


class MarketCollector(Collector):
    """What the clock told last; asks nobody."""

    def __init__(self, link: MarketLink, frames: Frames) -> None:
        self._link = link
        self._frames = frames

    def describe(self) -> Iterable[Metric]:
        """Nothing before there is a market."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The market's figures at this moment."""
        yield _gauge("zengrid_market_up", "Whether the market's clock is there.", float(self._link.feed.present))
        yield _gauge("zengrid_live_clients", "Clients that watch the market live.", self._frames.clients)
        if self._link.feed.latest is not None:
            age = time.monotonic() - self._link.feed.latest_at
            yield _gauge("zengrid_last_slot_age_seconds", "Time since the last settled slot was heard of.", age)
        status = self._link.status
        if status is not None:
            yield from _market(status)
            yield from _agents(status)


def _gauge(name: str, text: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, text, value=value)


def _market(status: Status) -> Iterator[Metric]:
    totals = status.totals
    yield CounterMetricFamily("zengrid_slots", "Settled slots of this run.", value=totals.slots)
    yield _gauge("zengrid_slots_per_second", "Rate over the recent slots.", status.slots_per_s)
    yield _gauge("zengrid_day", "Day of the next slot.", status.day)
    if status.last is not None:
        yield _gauge("zengrid_buy_price", "What the grid pays for exports [$/kWh].", status.last.buy_price)
        yield _gauge("zengrid_sell_price", "What the grid charges for imports [$/kWh].", status.last.sell_price)
        yield _gauge("zengrid_demand_kw", "All that the grid sells [kW].", status.last.demand_kw)
        yield _gauge("zengrid_export_kw", "All that the homes export [kW].", status.last.export_kw)
        output = GaugeMetricFamily("zengrid_facility_kw", "Output of each facility [kW].", labels=["facility"])
        for i, power in enumerate(status.last.facility_kw.tolist()):
            output.add_metric([str(i + 1)], power)
        yield output
        yield _gauge("zengrid_homes", "Homes in the market.", status.last.homes)
    for name, text in (
        ("profit", "Profit of the grid since the start of the run [$]."),
        ("bills", "Bills of all homes since the start of the run [$]."),
        ("reserve_kwh", "Energy of the reserve since the start of the run [kWh]."),
    ):
        family = GaugeMetricFamily(f"zengrid_{name}", text, labels=["case"])
        family.add_metric(["market"], getattr(totals, name))
        family.add_metric(["baseline"], getattr(totals, f"baseline_{name}"))
        yield family
    yield _gauge("zengrid_curtailed_kwh", "Energy nobody could take [kWh].", totals.curtailed_kwh)
    yield _gauge("zengrid_unserved_kwh", "Demand nobody could meet [kWh].", totals.unserved_kwh)
    refused = CounterMetricFamily("zengrid_refused_actions", "Refused messages by cause.", labels=["cause"])
    for cause, count in status.refused.items():
        refused.add_metric([cause], count)
    yield refused
    waits, text = status.journal_waits, "How often a slot had to wait for the journal."
    yield CounterMetricFamily("zengrid_journal_waits", text, value=waits)
    yield _gauge("zengrid_journal_wait_seconds", "How long the market has been waiting for it.", status.journal_wait_s)
    yield from _latencies(status)


def _latencies(status: Status) -> Iterator[Metric]:
    """Since the clock was started, as it measures them."""
    phases = HistogramMetricFamily(
        "zengrid_phase_seconds", "Time from an observation to the last awaited answer.", labels=["phase"]
    )
    for phase in ("price", "battery"):
        times = getattr(status.latency, phase)
        phases.add_metric([phase], *_buckets(times))
    yield phases
    lag = HistogramMetricFamily("zengrid_journal_lag_seconds", "Time from a settlement until it is in the journal.")
    lag.add_metric([], *_buckets(status.latency.commit))
    yield lag


def _buckets(times: Histogram) -> tuple[list[tuple[str, float]], float]:
    """Cumulated, as Prometheus wants them; and the sum. [s]"""
    bounds = [f"{bound / 1000:g}" for bound in times.bounds_ms] + ["+Inf"]
    return list(zip(bounds, map(float, accumulate(times.counts)), strict=True)), times.sum_ms / 1000


def _agents(status: Status) -> Iterator[Metric]:
    presence = GaugeMetricFamily("zengrid_agents", "Agents by presence.", labels=["presence"])
    counted = Counter(agent.presence for agent in status.agents)
    for state in ("present", "absent", "away"):
        presence.add_metric([state], counted[state])
    yield presence
    acted = CounterMetricFamily("zengrid_actions", "Slots in which an agent's action counted.", labels=["agent"])
    fallbacks = CounterMetricFamily("zengrid_fallbacks", "Slots in which the fallback was used.", labels=["agent"])
    single = len(status.agents) <= AGENTS
    sums: dict[str, list[int]] = {}
    for agent in status.agents:
        both = sums.setdefault(agent.id if single or agent.role == "grid" else "prosumers", [0, 0])
        both[0] += agent.acted
        both[1] += agent.fallbacks
    for name, (acts, falls) in sums.items():
        acted.add_metric([name], acts)
        fallbacks.add_metric([name], falls)
    yield acted
    yield fallbacks


class Metrics:
    """The gateway's registry."""

    def __init__(self, link: MarketLink, frames: Frames) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(MarketCollector(link, frames))
        ProcessCollector(registry=self._registry)
        self._times = prometheus_client.Histogram(
            "zengrid_http_seconds",
            "Time to begin an answer.",
            labelnames=["route", "status"],
            buckets=BUCKETS,
            registry=self._registry,
        )

    def answered(self, route: str, status: int, seconds: float) -> None:
        """Note an answer."""
        self._times.labels(route, status).observe(seconds)

    def text(self) -> bytes:
        """As Prometheus reads it."""
        return generate_latest(self._registry)


async def _metrics(connection: HTTPConnection) -> Metrics:
    metrics: Metrics = connection.app.state.metrics
    return metrics


@router.get(
    "/metrics",
    response_class=Response,
    responses={
        200: {"content": {"text/plain": {"schema": {"type": "string"}, "example": "zengrid_market_up 1.0\n"}}},
        **documented(),
    },
)
async def metrics(metrics: Annotated[Metrics, Depends(_metrics)]) -> Response:
    """Figures for Prometheus."""
    return Response(metrics.text(), media_type=CONTENT_TYPE_LATEST)
