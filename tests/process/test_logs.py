"""With one switch every process of a market tells all it tells as JSON, and a killed agent can be found in it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from support.gateway_process import gateway, start_spawner
from zengrid.testing import Process, RunningMarket


def lines(process: Process) -> list[dict[str, Any]]:
    """What it has told, all of it JSON."""
    return [json.loads(line) for line in process.output().splitlines()]


def position(line: dict[str, Any]) -> int:
    """The slot a line is about, counted from the first."""
    return int(line["day"]) * 24 + int(line["slot"])


@pytest.mark.slow
def test_every_line_is_json_and_tells_who_was_killed_when(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENGRID_LOG", "json")
    monkeypatch.setenv("ZENGRID_LOG_LEVEL", "debug")
    with RunningMarket("paper") as market:
        market.start_agents("p1", "p2", "p3")
        market.wait_for_slots(3)
        start_spawner(market)
        with gateway(market) as http:
            http.wait("/v1/spawners", lambda response: bool(response.json().get("spawners")), "the spawner")
            http.get("/v1/prise", 404)
            http.post("/v1/prosumers", {"id": "p4", "pv_kw": 2, "policy": "conventional"}, 201)
        market.processes["p2"].kill()
        market.wait_for_slot(lambda slot: "p2" not in slot.acted, missing="a slot without p2")
        killed = market.processes.pop("p2")
        market.start_prosumer("p2")
        market.wait_for_slot(lambda slot: "p2" in slot.acted, missing="p2 back")
        market.client.control("stop")
        assert market.processes["clock"].end() == 0
        told = {name: lines(process) for name, process in market.processes.items()} | {"killed": lines(killed)}
    assert all(told.values())
    assert {line["run"] for each in told.values() for line in each} == {"test"}
    away = next(line for line in told["clock"] if line["event"] == "agent is away" and line["agent"] == "p2")
    assert (away["level"], away["service"], away["before"]) == ("info", "clock", "present")
    later = [line for line in told["clock"][told["clock"].index(away) :] if line.get("agent") == "p2"]
    fallback, back = (next(line for line in later if line["event"] == what) for what in ("fallback", "agent is back"))
    # It dies before it has answered, or after: then the next slot is the first without it.
    assert position(fallback) - position(away) in (0, 1)
    assert position(back) > position(fallback)
    assert told["clock"][-1]["event"] == "run is over"
    assert told["p2"][0]["agent"] == "p2"
    started = next(line for line in told["spawner"] if line.get("agent") == "p4")
    assert started["service"] == "spawner"
    assert any(line.get("path") == "/v1/prise" and line["status"] == 404 for line in told["gateway"])
