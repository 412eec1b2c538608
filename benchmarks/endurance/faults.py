"""Faults at random: which come next, how each is inflicted, and when the market has recovered from it."""

from __future__ import annotations

import random
import time
from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple
from urllib.error import URLError
from urllib.request import urlopen

from endurance.observer import RECOVERY_S, ObservedSlot, Observer
from zengrid.bus.market_client import MarketClient
from zengrid.errors import ZengridError
from zengrid.scenario import HomeSpec
from zengrid.wire.spawner_queries import SpawnRequest, StopRequest

KILLS_A_MINUTE = 3
"""How often one process may be killed: ``zengrid up`` gives up one that fails six times within a minute."""
SPAWNED = ("s1", "s2", "s3")
SCENARIO_AGENTS = ("p1", "p2", "p3")
WEIGHTS = {
    "kill agent": 5.0,
    "stop agent": 4.0,
    "kill grid": 2.0,
    "stop grid": 1.0,
    "kill clock": 3.0,
    "stop clock": 2.0,
    "kill gateway": 1.0,
    "kill spawner": 0.5,
    "kill several": 1.0,
    "add home": 3.0,
    "remove home": 2.0,
    "kill spawned home": 2.0,
}
"""How likely each kind of fault is."""


class Fault(NamedTuple):
    """One fault and the recovery from it."""

    kind: str
    target: str
    at_s: float
    recovery_s: float | None
    """None: not within ``RECOVERY_S``"""
    pause_s: float
    """longest time without a new slot, from the fault until the recovery"""


class FaultInjector:
    """Inflicts faults on a market, one after the other.

    Parameters
    ----------
    observer:
        Of the market.
    client:
        An operator of it.
    price_url:
        Where its gateway gives the price.
    rng:
        Draws the faults.
    """

    def __init__(self, observer: Observer, client: MarketClient, price_url: str, rng: random.Random) -> None:
        self.observer, self.client, self.price_url, self.random = observer, client, price_url, rng
        self.findings: list[str] = []
        self._kills: dict[str, list[float]] = defaultdict(list)

    def draw(self) -> tuple[str, str]:
        """Kind and target of the next fault; nothing that was killed too often within the last minute."""
        spawned = self.spawned()
        while True:
            (kind,) = self.random.choices(list(WEIGHTS), list(WEIGHTS.values()))
            targets = candidates(kind, spawned)
            if not targets:
                continue
            target = self.random.choice(targets)
            recent = [at for at in self._kills[target] if at > time.monotonic() - 60.0]
            if not kind.startswith("kill") or len(recent) < KILLS_A_MINUTE:
                return kind, target

    def inflict(self, kind: str, target: str) -> Fault:
        """Inflict a fault, and wait until its target takes part again."""
        first, at = len(self.observer.slots), time.monotonic()
        agents = frozenset({"grid", *SCENARIO_AGENTS, *self.spawned()})
        since = at
        if kind.startswith("stop"):
            since = self._stop(kind, target)
            acted = frozenset({target}) if target != "clock" else agents
            recovered = self.observer.wait_for_slot(lambda slot: acted <= slot.acted, since)
        elif kind in ("kill clock", "kill several"):
            several = ("grid", self.random.choice(SCENARIO_AGENTS)) if kind == "kill several" else ()
            self._kill("clock", *several)
            recovered = self._wait(lambda slot: agents <= slot.acted)
        elif kind == "kill gateway":
            self._kill("gateway")
            recovered = self.wait_for_gateway()
        elif kind == "kill spawner":
            recovered = self._replace_spawner()
        elif kind == "add home":
            recovered = self._add(target)
        elif kind == "remove home":
            self._request(lambda spawner: self.client.stop_process(spawner, StopRequest(id=target)))
            recovered = self._wait(lambda slot: target not in slot.agents)
        else:
            self._kill(target)
            recovered = self.observer.wait_for_slot(lambda slot: target not in slot.acted, at) and self._wait(
                lambda slot: target in slot.acted
            )
        now = time.monotonic()
        times = [at, *(slot.at for slot in self.observer.slots[first:] if slot.at <= now), now]
        pause_s = max(after - before for before, after in pairwise(times))
        return Fault(kind, target, at, now - since if recovered else None, pause_s)

    def spawned(self) -> list[str]:
        """Homes that a spawner runs now."""
        titles = self.observer.processes()
        return sorted(home for home in SPAWNED if any(title.endswith(f" {home}") for title in titles))

    def wait_for_gateway(self) -> bool:
        """Wait until the gateway gives the price."""

        def answered() -> bool:
            try:
                with urlopen(self.price_url, timeout=5) as reply:
                    return bool(reply.status == 200)
            except (URLError, OSError):
                return False

        return self._poll(answered)

    def wait_for_spawner(self) -> bool:
        """Wait until a spawner answers."""
        return self._poll(lambda: bool(self.client.spawners()))

    def _wait(self, wanted: Callable[[ObservedSlot], bool]) -> bool:
        return self.observer.wait_for_slot(wanted, time.monotonic())

    def _poll(self, done: Callable[[], bool]) -> bool:
        until = time.monotonic() + RECOVERY_S
        while time.monotonic() < until:
            if done():
                return True
            time.sleep(0.05)
        return False

    def _kill(self, *titles: str) -> None:
        """Send SIGKILL."""
        for title in titles:
            process = self.observer.process(title)
            self._kills[title].append(time.monotonic())
            process.kill()

    def _stop(self, kind: str, target: str) -> float:
        """Stop a process for a while; returns when it was continued."""
        process = self.observer.process(target)
        seconds = self.random.uniform(0.2, 6.0 if kind == "stop agent" else 3.0)
        process.suspend()
        time.sleep(seconds)
        process.resume()
        return time.monotonic()

    def _replace_spawner(self) -> bool:
        """Kill the spawner; a fallback acts for its homes until new processes take them over."""
        lost = self.spawned()
        self._kill("spawner")
        recovered = self.wait_for_spawner()
        for home in lost:
            recovered = self._add(home) and recovered
        return recovered

    def _add(self, home: str) -> bool:
        """Have a spawner start a home, and wait until it acts."""
        body = {"id": home, "pv_kw": 4.0, "battery": {"capacity_kwh": 8.0}}
        spec = HomeSpec.model_validate(body)
        self._request(lambda spawner: self.client.spawn(spawner, SpawnRequest(home=spec)))
        return self._wait(lambda slot: home in slot.acted)

    def _request(self, send: Callable[[str], Any]) -> None:
        """Send a spawner a request; again while it or the clock is being restarted."""
        until = time.monotonic() + RECOVERY_S
        while True:
            try:
                send(self.client.spawners()[0].spawner)
                return
            except (ZengridError, IndexError) as error:
                if time.monotonic() > until:
                    self.findings.append(f"spawner: {error}")
                    return
                time.sleep(0.1)


def candidates(kind: str, spawned: list[str]) -> list[str]:
    """Targets of a kind of fault, given the homes that a spawner runs."""
    return {
        "kill agent": list(SCENARIO_AGENTS),
        "stop agent": [*SCENARIO_AGENTS, *spawned],
        "kill grid": ["grid"],
        "stop grid": ["grid"],
        "kill clock": ["clock"],
        "stop clock": ["clock"],
        "kill gateway": ["gateway"],
        "kill spawner": ["spawner"],
        "kill several": ["clock"],
        "add home": [home for home in SPAWNED if home not in spawned],
        "remove home": spawned,
        "kill spawned home": spawned,
    }[kind]
