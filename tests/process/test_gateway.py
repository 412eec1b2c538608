"""The gateway beside a real market: prices, state, history, live streams, policies, control."""

from __future__ import annotations

import io
import math
import socket
from collections.abc import Iterator

import httpx
import pyarrow.csv
import pyarrow.parquet
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from support.gateway_process import Gateway, events, running
from zengrid.wire.codec import decode
from zengrid.wire.queries import Status
from zengrid.wire.slots import PublicSlot

PACED = ("--speed", "180000x")
"""50 slots a second."""


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gateway]:
    with running(*PACED) as it:
        yield it


def test_the_price_is_that_of_the_latest_slot(gateway: Gateway) -> None:
    price = gateway.get("/v1/price")
    assert price["run"] == "test"
    assert price["state"] == "running"
    assert price["time"] == f"{price['slot']:02d}:00"
    assert price["position"] == price["day"] * 24 + price["slot"]
    first = price["position"]
    later = gateway.wait("/v1/price", lambda answer: answer.json()["position"] > first + 24, "a day").json()
    slot = gateway.market.wait_for_slot(later["position"])
    assert later["sell_price"] == (0.05 if later["slot"] < 11 else 0.095)
    assert later["buy_price"] == (0.05 if later["slot"] < 11 else 0.07 if later["slot"] < 17 else 0.1)
    assert slot.position >= later["position"]


def test_market_is_the_clocks_status(gateway: Gateway) -> None:
    status = decode(Status, gateway.http.get("/v1/market").content)
    assert status.run == "test"
    assert status.homes is None
    assert [agent.id for agent in status.agents][:4] == ["grid", "p1", "p2", "p3"]
    assert status.last is not None


def test_prosumers_are_listed_in_pages(gateway: Gateway) -> None:
    answer = gateway.get("/v1/prosumers")
    ids = [home["id"] for home in answer["prosumers"]]
    assert ids[:3] == ["p1", "p2", "p3"]
    assert answer["total"] == len(ids)
    page = gateway.get("/v1/prosumers", params={"offset": 1, "limit": 1})
    assert [home["id"] for home in page["prosumers"]] == ["p2"]
    assert page["next"] == 2
    one = gateway.get("/v1/prosumers/p2")
    assert one["capacity_kwh"] == 12
    assert one["presence"] == "present"
    assert 0.1 <= one["soc"] <= 0.9
    missing = gateway.get("/v1/prosumers/nobody", 404)
    assert missing["type"] == "urn:zengrid:not-found"
    assert "p1, p2, p3" in missing["detail"]


def test_history_pages_are_complete(gateway: Gateway) -> None:
    last = gateway.market.wait_for_slots(1).position
    rows = []
    path: str | None = f"/v1/history?since=3&until={last}&limit=7"
    while path is not None:
        response = gateway.http.get(path)
        rows += response.json()["rows"]
        path = response.links["next"]["url"] if "next" in response.links else None
    assert [row["position"] for row in rows] == list(range(3, last))


def test_history_adds_up(gateway: Gateway) -> None:
    gateway.market.wait_for_slot(48)
    slots = gateway.get("/v1/history", params={"day": 1})["rows"]
    (day,) = gateway.get("/v1/history", params={"day": 1, "resolution": "day"})["rows"]
    assert len(slots) == 24
    assert math.isclose(day["profit"], sum(row["profit"] for row in slots))
    assert math.isclose(day["demand_kw"], sum(row["demand_kw"] for row in slots) / 24)
    assert day["position"] == 24
    home = gateway.get("/v1/prosumers/p1/history", params={"day": 1})["rows"]
    (home_day,) = gateway.get("/v1/prosumers/p1/history", params={"day": 1, "resolution": "day"})["rows"]
    assert home_day["soc"] == home[-1]["soc"]
    assert math.isclose(home_day["bill"], sum(row["bill"] for row in home))
    assert gateway.get("/v1/prosumers/nobody/history", 404)["status"] == 404


def test_csv_and_parquet_hold_the_rows_of_json(gateway: Gateway) -> None:
    gateway.market.wait_for_slot(24)
    rows = gateway.get("/v1/history", params={"day": 0})["rows"]
    csv = gateway.http.get("/v1/history", params={"day": 0, "format": "csv"})
    assert csv.headers["content-type"].startswith("text/csv")
    parquet = gateway.http.get("/v1/history", params={"day": 0, "format": "parquet"})
    for table in (
        pyarrow.csv.read_csv(io.BytesIO(csv.content)),
        pyarrow.parquet.read_table(io.BytesIO(parquet.content)),
    ):
        assert table.column("position").to_pylist() == [row["position"] for row in rows]
        assert table.column("profit").to_pylist() == pytest.approx([row["profit"] for row in rows])


def test_history_explains_what_is_wrong(gateway: Gateway) -> None:
    problem = gateway.get("/v1/history?limit=0&colour=red", 422)
    assert {error["field"] for error in problem["errors"]} == {"query.limit", "query.colour"}
    assert gateway.get("/v1/history?day=1&since=2", 422)["errors"][0]["field"] == "query.since"
    assert "test-9" in gateway.get("/v1/history?run=test-9", 404)["detail"]


def test_kpis_are_the_sums_of_the_history(gateway: Gateway) -> None:
    (run,) = gateway.get("/v1/runs")["runs"]
    assert run["name"] == "test-1"
    first = gateway.get("/v1/runs/test-1/kpis")
    gateway.market.wait_for_slot(first["slots"] + 5)
    then = gateway.get("/v1/runs/test-1/kpis")
    assert then["slots"] >= first["slots"] + 5
    rows = gateway.get("/v1/history", params={"until": then["slots"], "limit": 10_000})["rows"]
    assert math.isclose(then["profit"]["value"], sum(row["profit"] for row in rows))
    assert math.isclose(then["reserve_kwh"]["value"], sum(row["reserve_kw"] for row in rows))
    assert math.isclose(then["bills"]["value"], sum(kpi["value"] for kpi in then["prosumers"].values()))
    now = gateway.get("/v1/kpis")
    assert now["slots"] >= then["slots"] - 25
    assert set(now["prosumers"]) >= {"p1", "p2", "p3"}


def test_the_scenario_is_served_as_json_and_yaml(gateway: Gateway) -> None:
    scenario = gateway.get("/v1/scenario")
    assert scenario["name"] == "paper"
    assert [home["id"] for home in scenario["homes"]] == ["p1", "p2", "p3"]
    text = gateway.http.get("/v1/scenario", params={"format": "yaml"})
    assert text.headers["content-type"].startswith("application/yaml")
    assert gateway.get("/v1/scenario", params={"run": "test-1"}) == scenario


def test_live_stream_resumes_without_loss(gateway: Gateway) -> None:
    with gateway.http.stream("GET", "/v1/live") as response:
        stream = events(response)
        assert next(stream) == ("market", None, {"present": True})
        positions = [number for name, number, _ in (next(stream) for _ in range(10)) if name == "slot"]
    seen = positions[-1]
    assert seen is not None
    gateway.market.wait_for_slot(seen + 20)
    with gateway.http.stream("GET", "/v1/live", headers={"last-event-id": str(seen)}) as response:
        stream = events(response)
        next(stream)
        resumed = [next(stream) for _ in range(30)]
    assert [number for _, number, _ in resumed] == list(range(seen + 1, seen + 31))
    assert decode(PublicSlot, httpx.Response(200, json=resumed[0][2]).content).position == seen + 1


def test_live_stream_resumes_from_the_journal(gateway: Gateway) -> None:
    """Slots from before the gateway was started are not in its memory."""
    with gateway.http.stream("GET", "/v1/live", params={"since": 0}) as response:
        stream = events(response)
        next(stream)
        assert [next(stream)[1] for _ in range(5)] == [1, 2, 3, 4, 5]


def test_a_websocket_sends_the_same_events(gateway: Gateway) -> None:
    with connect(f"ws://127.0.0.1:{gateway.port}/v1/live") as socket_:
        messages = [socket_.recv(timeout=10) for _ in range(4)]
    assert messages[0] == '{"event":"market","data":{"present":true}}'
    assert all(isinstance(message, str) and message.startswith('{"event":"slot","id":') for message in messages[1:])


def test_a_websocket_of_another_site_is_refused(gateway: Gateway) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{gateway.port}/v1/live", origin=Origin("https://elsewhere.example"))


def test_a_stuck_client_costs_only_itself(gateway: Gateway) -> None:
    with socket.create_connection(("127.0.0.1", gateway.port)) as stuck:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stuck.sendall(b"GET /v1/live?since=0 HTTP/1.1\r\nHost: localhost\r\n\r\n")
        first = gateway.get("/v1/price")["position"]
        with gateway.http.stream("GET", "/v1/live") as response:
            stream = events(response)
            assert any(number is not None and number > first for _, number, _ in (next(stream) for _ in range(20)))
        gateway.wait("/v1/price", lambda answer: answer.json()["position"] > first + 10, "newer prices")


def test_a_policy_answers_quantities_and_observations(gateway: Gateway) -> None:
    listed = {each["agent"]: each["policy"] for each in gateway.get("/v1/policies")["policies"]}
    assert listed["p1"] == "conventional"
    details = gateway.get("/v1/policies/p1")
    assert details["features"][:4] == ["soc", "pv_kw", "load_kw", "buy_price"]
    wanted = {"soc": [0.2, 0.5, 0.8], "pv_kw": 3.0, "load_kw": 1.5, "hour": 13}
    answer = gateway.post("/v1/policies/p1/query", {"quantities": wanted})
    assert answer["actions"] == [1.5, 1.5, 1.5]
    row = [0.5, 3.0, 1.0, 0.07, 0.0, -1.0, 0.095]
    assert gateway.post("/v1/policies/p1/query", {"observations": [row]})["actions"] == [2.0]
    grid = gateway.post("/v1/policies/grid/query", {"quantities": {"hour": [3, 12, 20]}})
    assert grid["actions"] == [0.05, 0.07, 0.1]


def test_a_policy_answers_many_questions(gateway: Gateway) -> None:
    pv = [i / 1000 for i in range(5000)]
    answer = gateway.post("/v1/policies/p1/query", {"quantities": {"pv_kw": pv, "load_kw": 0, "soc": 0.5}})
    assert answer["actions"] == pytest.approx([min(power, 2.0) for power in pv])


@pytest.mark.parametrize(
    ("body", "field", "allowed"),
    [
        ({"quantities": {"colour": 1}}, "body.quantities.colour", "soc, pv_kw, load_kw, buy_price, sell_price, hour"),
        ({"quantities": {"soc": [0.1, 0.2], "pv_kw": [1]}}, "body.quantities.pv_kw", "one length"),
        ({}, "body", "one of the two"),
        ({"observations": []}, "body.observations", "at least 1"),
        ({"quantities": {"soc": [0.1, "much"]}}, "body.quantities.soc.1", "number"),
        ({"quantities": {"soc": "much"}}, "body.quantities.soc", "number; or: Input should be a valid list"),
        ({"quantities": {}, "colour": 1}, "body.colour", "there are quantities, observations, home"),
    ],
)
def test_policy_questions_that_make_no_sense(gateway: Gateway, body: object, field: str, allowed: str) -> None:
    (error,) = gateway.post("/v1/policies/p1/query", body, 422)["errors"]
    assert error["field"] == field
    assert allowed in error["allowed"]


def test_a_head_is_that_of_get(gateway: Gateway) -> None:
    for path in ("/v1/price", "/v1/market", "/v1/live", "/"):
        answer = gateway.http.head(path)
        assert (answer.status_code, answer.content) == (200, b"")
    assert gateway.http.head("/v1/nothing").status_code == 404


def test_control_pauses_steps_and_resumes(gateway: Gateway) -> None:
    assert gateway.post("/v1/control", {"command": "pause"})["state"] == "paused"
    still = gateway.market.client.control("status")
    assert gateway.get("/v1/price")["state"] == "paused"
    stepped = gateway.post("/v1/control", {"command": "step", "slots": 3})
    assert stepped["state"] in ("running", "paused")
    then = gateway.market.wait_for_status(
        lambda status: status.state == "paused", missing="the pause after three slots"
    )
    assert (then.day * 24 + then.slot) - (still.day * 24 + still.slot) == 3
    assert gateway.post("/v1/control", {"command": "speed", "speed": 90000})["speed"] == 90000
    assert gateway.post("/v1/control", {"command": "speed", "speed": 180000})["speed"] == 180000
    assert gateway.post("/v1/control", {"command": "resume"})["state"] == "running"
    assert "0 to 1e9" in gateway.post("/v1/control", {"command": "speed"}, 422)["detail"]
    assert gateway.post("/v1/control", {"command": "explode"}, 422)["errors"][0]["field"] == "body.command"


def test_pages_of_other_sites_cannot_steer(gateway: Gateway) -> None:
    elsewhere = {"origin": "https://elsewhere.example"}
    assert gateway.post("/v1/control", {"command": "pause"}, 403, headers=elsewhere)["status"] == 403
    form = gateway.http.post("/v1/control", content=b'{"command":"pause"}', headers={"content-type": "text/plain"})
    assert form.status_code == 422
    assert "application/json" in form.json()["detail"]
    assert gateway.get("/v1/price", 421, headers={"host": "elsewhere.example"})["type"] == "urn:zengrid:misdirected"


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:1", "127.0.0.1:80", "127.0.0.2", "[::1]", "[::1]:8080"])
def test_names_of_this_machine(gateway: Gateway, host: str) -> None:
    assert gateway.get("/healthz", headers={"host": host}) == {"status": "ok"}


@pytest.mark.parametrize(
    "host", ["[::1].evil.com", "[::1]evil.com:80", "localhost.evil.com", "evil.com:80", "[::1", ":80"]
)
def test_names_of_other_machines(gateway: Gateway, host: str) -> None:
    assert gateway.get("/healthz", 421, headers={"host": host})["type"] == "urn:zengrid:misdirected"


def test_metrics_report_the_market(gateway: Gateway) -> None:
    text = gateway.http.get("/metrics").text
    lines = dict(line.rsplit(" ", 1) for line in text.splitlines() if not line.startswith("#"))
    assert float(lines["zengrid_market_up"]) == 1
    assert float(lines["zengrid_slots_total"]) > 0
    slots = float(lines['zengrid_phase_seconds_count{phase="price"}'])
    assert slots > 0
    assert float(lines['zengrid_phase_seconds_bucket{le="+Inf",phase="price"}']) == slots
    assert float(lines["zengrid_journal_lag_seconds_sum"]) > 0
    assert 'zengrid_fallbacks_total{agent="p1"}' in lines
    assert float(lines['zengrid_http_seconds_count{route="/v1/price",status="200"}']) > 0


def test_answers_forbid_what_pages_do_not_need(gateway: Gateway) -> None:
    headers = gateway.http.get("/").headers
    assert headers["x-content-type-options"] == "nosniff"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "path", ["/../pyproject.toml", "/..%2f..%2fetc%2fpasswd", "/static/main.js", "/main.js/../../x"]
)
def test_no_name_reaches_the_file_system(gateway: Gateway, path: str) -> None:
    with socket.create_connection(("127.0.0.1", gateway.port)) as raw:
        raw.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n".encode())
        answer = b"".join(iter(lambda: raw.recv(65536), b""))
    assert answer.startswith(b"HTTP/1.1 404")


def test_large_bodies_are_refused(gateway: Gateway) -> None:
    body = b'{"observations": [' + b"[1]," * 2**20 + b"[1]]}"
    response = gateway.http.post("/v1/policies/p1/query", content=body, headers={"content-type": "application/json"})
    assert response.status_code == 413
    assert response.json()["type"] == "urn:zengrid:too-large"


def test_bodies_without_length_are_refused(gateway: Gateway) -> None:
    response = gateway.http.post("/v1/control", content=iter([b"{}"]), headers={"content-type": "application/json"})
    assert response.status_code == 411
