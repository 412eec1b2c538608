"""A gateway whose market is not there yet, dies, comes back, or ends; and one that may not read the journal."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import httpx
import pytest

from support.gateway_process import Gateway, events, gateway, running
from zengrid.testing import RunningMarket


def is_away(response: httpx.Response) -> bool:
    return response.status_code == 503 and response.json()["type"] == "urn:zengrid:market-away"


def position(response: httpx.Response) -> int:
    """Of the price; -1 where there is none."""
    return int(response.json()["position"]) if response.status_code == 200 else -1


def test_a_gateway_waits_for_its_market() -> None:
    with RunningMarket("paper") as market:
        market.processes["clock"].kill()
        it = Gateway(market)
        with it.http:
            away = it.wait("/v1/price", is_away, "the word that the market is away")
            assert away.headers["content-type"] == "application/problem+json"
            assert away.headers["retry-after"] == "1"
            assert market.endpoint in away.json()["detail"]
            assert it.get("/healthz") == {"status": "ok"}
            assert it.get("/readyz", 503)["status"] == 503
            market.start_clock()
            market.start_agents("p1", "p2", "p3")
            it.ready()
            it.wait("/v1/price", lambda response: response.status_code == 200, "a price")


def test_a_market_that_dies_and_comes_back() -> None:
    with running("--speed", "180000x") as it:
        market = it.market
        with it.http.stream("GET", "/v1/live") as response:
            stream = events(response)
            before = next(number for name, number, _ in stream if name == "slot")
            assert before is not None
            market.processes["clock"].kill()
            assert next(data for name, _, data in stream if name == "market") == {"present": False}
            it.wait("/v1/price", is_away, "the word that the market is away")
            # The journal is there all the same.
            assert it.get("/v1/history", params={"limit": 3})["rows"][2]["position"] == 2
            assert it.get("/v1/scenario")["name"] == "paper"
            market.start_clock("--resume")
            assert next(data for name, _, data in stream if name == "market") == {"present": True}
            after = next(number for name, number, _ in stream if name == "slot")
        assert after is not None
        assert after > before
        it.wait(
            "/v1/price", lambda answer: answer.status_code == 200 and answer.json()["position"] > after, "prices", 10.0
        )


def test_the_end_of_a_market() -> None:
    with running("--days", "3", "--speed", "3600x") as it:
        it.post("/v1/control", {"command": "speed", "speed": 0})
        away = it.wait("/v1/price", is_away, "the end of the market")
        assert away.status_code == 503
        assert it.get("/v1/history", params={"resolution": "day"})["rows"][-1]["day"] == 2
        assert it.get("/v1/runs")["runs"][0]["finished_at"] is not None
        assert it.get("/v1/runs/test-1/kpis")["slots"] == 72


def test_a_new_market_begins_at_its_first_slot() -> None:
    with running("--speed", "180000x") as it:
        market = it.market
        market.wait_for_slot(30)
        market.client.control("stop")
        market.processes["clock"].end()
        market.start_clock("--speed", "3600x", "--wait", "0")
        price = it.wait(
            "/v1/price", lambda answer: answer.status_code == 200 and answer.json()["position"] < 20, "a new run"
        )
        assert price.json()["day"] == 0
        assert [run["name"] for run in it.get("/v1/runs")["runs"]] == ["test-1", "test-2"]
        assert it.get("/v1/history", params={"run": "test-1", "since": 25, "limit": 1})["rows"][0]["position"] == 25


@pytest.fixture(scope="module")
def without_journal() -> Iterator[Gateway]:
    with running("--speed", "180000x", journal=False) as it:
        yield it


def test_history_from_the_clock_alone(without_journal: Gateway) -> None:
    it = without_journal
    last = it.wait("/v1/price", lambda answer: position(answer) > 60, "slot 60").json()["position"]
    rows = it.get("/v1/history", params={"until": last})["rows"]
    assert [row["position"] for row in rows] == list(range(last))
    with gateway(it.market, "--journal", str(it.market.journal)) as reads:
        assert reads.get("/v1/history", params={"until": last})["rows"] == rows
        path = "/v1/prosumers/p2/history"
        home = it.get(path, params={"until": last, "resolution": "day"})["rows"]
        assert reads.get(path, params={"until": last, "resolution": "day"})["rows"] == home
    assert "--journal" in it.get("/v1/runs", 404)["detail"]
    assert it.get("/v1/prosumers/nobody/history", 404)["status"] == 404


def test_a_gateway_with_an_open_stream_ends_at_once(without_journal: Gateway) -> None:
    it = without_journal
    with gateway(it.market) as other, other.http.stream("GET", "/v1/live") as response:
        next(events(response))
        other.process.signal(signal.SIGTERM)
        assert other.process.end(5.0) == 0
