"""Gateways and spawners as processes beside a real market, and what tests ask of them."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import httpx

from zengrid.testing import Process, RunningMarket, free_port

START_S = 60.0
"""Longest wait for what comes within a second where nothing else runs."""


class Gateway:
    """A running gateway. ``http`` asks it."""

    def __init__(self, market: RunningMarket, *options: str) -> None:
        self.market = market
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        command = (sys.executable, "-m", "zengrid_gateway", "--connect", market.endpoint, "--run", market.run)
        name = next(name for name in ("gateway", *map(str, range(100))) if name not in market.processes)
        self.process: Process = market.start(name, *command, "--port", str(self.port), *options)
        self.http = httpx.Client(base_url=self.url, timeout=60.0)

    def wait(self, path: str, wanted: Callable[[httpx.Response], bool], missing: str, within_s: float = START_S) -> Any:
        """Ask again and again until an answer fits; returns it."""
        until = time.monotonic() + within_s
        last: object = None
        while time.monotonic() < until:
            try:
                response = self.http.get(path)
                if wanted(response):
                    return response
                last = response.text[-500:]
            except httpx.TransportError as error:
                last = error
                if self.process.popen.poll() is not None:
                    break
            time.sleep(0.02)
        raise AssertionError(f"{missing} did not come within {within_s:g} s; last was {last}\n{self.market.output()}")

    def ready(self) -> None:
        """Wait until it shows the market."""
        self.wait("/readyz", lambda response: response.status_code == 200, "the gateway")

    def get(self, path: str, status: int = 200, **options: Any) -> Any:
        """The JSON of an answer."""
        response = self.http.get(path, **options)
        assert response.status_code == status, f"{path}: {response.status_code} {response.text[:1000]}"
        return response.json()

    def post(self, path: str, body: object, status: int = 200, **options: Any) -> Any:
        """The same for a question with a body."""
        response = self.http.post(path, json=body, **options)
        assert response.status_code == status, f"{path}: {response.status_code} {response.text[:1000]}"
        return response.json()


@contextmanager
def gateway(market: RunningMarket, *options: str) -> Iterator[Gateway]:
    """A gateway that is ready."""
    it = Gateway(market, *options)
    with it.http:
        it.ready()
        yield it


@contextmanager
def running(
    *clock_options: str, journal: bool = True, spawner: tuple[str, ...] = (), rest: str = "conventional"
) -> Iterator[Gateway]:
    """A whole market of the paper with its gateway and a spawner; all homes but the first play ``rest``."""
    with RunningMarket("paper", clock_options) as market:
        market.start_agents("p1", grid_policy="tou:0.05,11:00=0.07,17:00=0.1")
        for agent in ("p2", "p3"):
            market.start_prosumer(agent, "--policy", rest)
        start_spawner(market, *spawner)
        market.wait_for_slots(2)
        with gateway(market, *(("--journal", str(market.journal)) if journal else ())) as it:
            it.wait("/v1/spawners", lambda response: bool(response.json().get("spawners")), "the spawner")
            yield it


def start_spawner(market: RunningMarket, *options: str) -> Process:
    """A spawner for this market."""
    where = ("--connect", market.endpoint, "--run", market.run, "--logs", str(market.folder / "spawner"))
    return market.start("spawner", sys.executable, "-m", "zengrid_spawner", *where, *options)


def events(response: httpx.Response) -> Iterator[tuple[str, int | None, Any]]:
    """Server-sent events: name, id, data."""
    fields: dict[str, str] = {}
    for line in response.iter_lines():
        if line:
            name, _, value = line.partition(":")
            fields[name] = value.strip()
        elif "event" in fields:
            number = int(fields["id"]) if "id" in fields else None
            yield fields["event"], number, json.loads(fields["data"])
            fields = {}
        else:
            fields = {}
