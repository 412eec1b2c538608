"""Homes added and removed over HTTP: each is a process that a spawner looks after."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

from support.gateway_process import Gateway, running, start_spawner

HOME = {"id": "p4", "pv_kw": 5, "battery": {"capacity_kwh": 10}}


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gateway]:
    with running("--speed", "72000x") as it:
        yield it


def test_a_home_comes_and_goes(gateway: Gateway) -> None:
    started = gateway.post("/v1/prosumers", HOME, 201)
    assert started["process"]["state"] == "running"
    os.kill(started["process"]["pid"], 0)
    home = gateway.wait("/v1/prosumers/p4", lambda answer: answer.status_code == 200, "the home").json()
    assert home["capacity_kwh"] == 10
    gateway.wait("/v1/prosumers/p4", lambda answer: answer.json()["acted"] > 3, "its actions")
    assert gateway.get("/v1/spawners")["spawners"][0]["processes"][0]["id"] == "p4"
    assert gateway.http.delete("/v1/prosumers/p4").status_code == 204
    gateway.wait("/v1/prosumers/p4", lambda answer: answer.status_code == 404, "its leaving")
    with pytest.raises(ProcessLookupError):
        os.kill(started["process"]["pid"], 0)
    assert gateway.http.delete("/v1/prosumers/p4").status_code == 404


def test_the_same_key_starts_nothing_twice(gateway: Gateway) -> None:
    home = HOME | {"id": "p5"}
    key = {"idempotency-key": "a key of this test"}
    first = gateway.post("/v1/prosumers", home, 201, headers=key)
    again = gateway.post("/v1/prosumers", home, 201, headers=key)
    assert again["process"]["pid"] == first["process"]["pid"]
    assert "used for another request" in gateway.post("/v1/prosumers", home | {"pv_kw": 6}, 409, headers=key)["detail"]
    assert "runs here already" in gateway.post("/v1/prosumers", home, 409)["detail"]
    assert gateway.http.delete("/v1/prosumers/p5").status_code == 204


@pytest.mark.parametrize(
    ("home", "status", "says"),
    [
        (HOME | {"id": "p1"}, 409, "another process plays it"),
        (HOME | {"id": "grid"}, 409, "another process plays it"),
        (HOME | {"pv_kw": -1}, 422, "body.pv_kw"),
        (HOME | {"id": "No Name"}, 422, "body.id"),
        (HOME | {"load": {"profile": "nobody"}}, 422, "prosumer1, prosumer2, prosumer3"),
        (HOME | {"policy": "/etc/passwd"}, 422, "this spawner knows trained"),
        (HOME | {"policy": "random:x"}, 422, "policy"),
        (HOME | {"colour": "red"}, 422, "body.colour"),
    ],
)
def test_a_refused_home_names_the_wrong_field(gateway: Gateway, home: object, status: int, says: str) -> None:
    problem = gateway.post("/v1/prosumers", home, status)
    assert says in problem["detail"]
    assert all(error["field"].startswith("body.") for error in problem["errors"])
    assert problem["errors"]
    gateway.wait("/v1/prosumers", lambda answer: answer.json()["total"] == 3, "nobody beside the three")


def test_homes_started_elsewhere_are_ended_there(gateway: Gateway) -> None:
    refused = gateway.http.delete("/v1/prosumers/p1")
    assert refused.status_code == 409
    assert "end it where it was started" in refused.json()["detail"]


def test_a_process_that_dies_is_started_again(gateway: Gateway) -> None:
    pid = gateway.post("/v1/prosumers", HOME | {"id": "p6"}, 201)["process"]["pid"]
    os.kill(pid, signal.SIGKILL)

    def again(answer: object) -> bool:
        (process,) = gateway.get("/v1/spawners")["spawners"][0]["processes"]
        return bool(process["state"] == "running" and process["restarts"] == 1 and process["pid"] != pid)

    gateway.wait("/v1/spawners", again, "the second life")
    gateway.wait("/v1/prosumers/p6", lambda answer: answer.json()["presence"] == "present", "its presence")
    assert gateway.http.delete("/v1/prosumers/p6").status_code == 204


def test_a_full_spawner_refuses_and_another_takes_over(gateway: Gateway) -> None:
    market = gateway.market
    market.processes["spawner"].signal(signal.SIGTERM)
    assert market.processes["spawner"].end() == 0
    gateway.wait("/v1/spawners", lambda answer: answer.json()["spawners"] == [], "the spawner's end")
    assert "zengrid spawner" in gateway.post("/v1/prosumers", HOME, 503)["detail"]
    start_spawner(market, "--name", "small", "--limit", "1")
    gateway.wait("/v1/spawners", lambda answer: len(answer.json()["spawners"]) == 1, "the small spawner")
    assert gateway.post("/v1/prosumers", HOME | {"id": "p7"}, 201)["spawner"] == "small"
    assert "1 at most" in gateway.post("/v1/prosumers", HOME | {"id": "p8"}, 409)["detail"]
    other = ("--connect", market.endpoint, "--run", market.run, "--logs", str(market.folder / "other"))
    market.start("other", *market.processes["spawner"].popen.args[:3], *other, "--name", "other")  # type: ignore[index]
    gateway.wait("/v1/spawners", lambda answer: len(answer.json()["spawners"]) == 2, "the other spawner")
    assert gateway.post("/v1/prosumers", HOME | {"id": "p8"}, 201)["spawner"] == "other"
    for name in ("spawner", "other"):
        # Its homes leave with a spawner.
        market.processes[name].signal(signal.SIGTERM)
        assert market.processes[name].end() == 0
    gateway.wait("/v1/prosumers", lambda answer: answer.json()["total"] == 3, "their leaving")
