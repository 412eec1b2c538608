"""The market over bare Zenoh, the most that a market over Zenoh can reach: messages and nothing else.

    python benchmarks/peers/zenoh_market.py --homes 3

One process for the environment and each agent, the same number of messages a slot as in zengrid, as JSON through
pydantic's models. While time is taken nothing is settled, stored or waited for with a deadline: observations of all
slots are prepared before, and the decisions that came back are settled afterwards, and compared with zengrid's core.
Needs nothing but zengrid's own dependencies. Prints figures as JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from agent_rules import battery_kw, buy_price

# Zenoh does all its work on two threads, which is its fastest setting for this exchange. Read when a session opens.
os.environ.setdefault(
    "ZENOH_RUNTIME",
    "(rx: (handover: app), acc: (handover: app), tx: (handover: app), net: (handover: app), app: (worker_threads: 2))",
)
START_S = 60.0
"""How long agents may take to connect. [s]"""


class Observation(BaseModel):
    """From the environment to an agent."""

    run: str
    slot: int
    agent: str
    buy_price: float | None
    values: list[float]
    """as in ``agent_rules``"""
    deadline_s: float


class Decision(BaseModel):
    """From an agent to the environment."""

    run: str
    slot: int
    agent: str
    value: float
    """buy price [$/kWh] or command [kW]"""
    policy: str
    version: int


def main() -> None:
    """Run the market, or one agent of it."""
    from same_market import peer_parser

    parser = peer_parser(__doc__, Path(__file__).name)
    parser.add_argument("--agent", help=argparse.SUPPRESS)
    parser.add_argument("--endpoint", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.agent:
        run_agent(options.agent, options.endpoint)
    else:
        run_market(options)


def open_session(mode: str, **endpoints: list[str]) -> Any:
    """A session that listens on or connects to these endpoints alone."""
    import zenoh

    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": endpoints.get("listen", []),
        "connect/endpoints": endpoints.get("connect", []),
        "connect/timeout_ms": int(START_S * 1e3),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def run_agent(agent: str, endpoint: str) -> None:
    """Answer observations until the environment closes this process's standard input."""
    import zenoh

    session = open_session("client", connect=[endpoint])
    publisher = declare_publisher(session, f"market/decision/{agent}")
    observations = session.declare_subscriber(f"market/observation/{agent}", zenoh.handlers.FifoChannel(1024))

    def answer() -> None:
        for sample in observations:
            seen = Observation.model_validate_json(sample.payload.to_bytes())
            value = buy_price(seen.values) if seen.buy_price is None else battery_kw(seen.buy_price, seen.values)
            decision = Decision(run=seen.run, slot=seen.slot, agent=agent, value=value, policy="rule", version=1)
            publisher.put(decision.model_dump_json())

    threading.Thread(target=answer, daemon=True).start()
    token = session.liveliness().declare_token(f"market/alive/{agent}")
    sys.stdin.read()
    token.undeclare()
    os._exit(0)  # the thread waits for observations that never come


def declare_publisher(session: Any, key: str) -> Any:
    """A publisher whose messages are sent at once and never dropped."""
    import zenoh

    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK, express=True)


class Exchange:
    """The environment's side of the messages."""

    def __init__(self, session: Any, homes: list[str]) -> None:
        import zenoh

        self.homes = homes
        self.decisions = session.declare_subscriber("market/decision/*", zenoh.handlers.FifoChannel(4096))
        self.observations = {
            agent: declare_publisher(session, f"market/observation/{agent}") for agent in ("grid", *homes)
        }
        self.settlements = declare_publisher(session, "market/settlement")

    def send(self, slot: int, agent: str, price: float | None, values: list[float]) -> None:
        """Send an observation."""
        message = Observation(run="run-0001", slot=slot, agent=agent, buy_price=price, values=values, deadline_s=1234.5)
        self.observations[agent].put(message.model_dump_json())

    def receive(self, slot: int) -> Decision:
        """The next decision, which has to be of this slot."""
        decision = Decision.model_validate_json(self.decisions.recv().payload.to_bytes())
        if decision.slot != slot:
            raise SystemExit(f"{decision.agent} answered slot {decision.slot} in slot {slot}")
        return decision

    def play(self, slot: int, grid: list[float], homes: list[list[float]]) -> tuple[float, list[float], float, float]:
        """One slot: the price, the commands, and how long each of both phases took. [s]"""
        began = time.perf_counter()
        self.send(slot, "grid", None, grid)
        price = self.receive(slot).value
        decided = time.perf_counter()
        for agent, values in zip(self.homes, homes, strict=True):
            self.send(slot, agent, price, values)
        answers = [self.receive(slot) for _ in self.homes]
        ended = time.perf_counter()
        self.settlements.put(b"x" * 150)
        by_home = {answer.agent: answer.value for answer in answers}
        return price, [by_home[agent] for agent in self.homes], decided - began, ended - decided


def run_market(options: argparse.Namespace) -> None:
    """Prepare observations, exchange messages, settle afterwards, report."""
    import numpy as np

    from same_market import Environment, free_port, report, result

    homes = [f"p{i + 1}" for i in range(options.homes)]
    prepared, count = Environment(options.homes), options.warm_up + options.slots
    observations = []
    for _ in range(count):
        grid, of_homes = prepared.observe()
        observations.append((grid, of_homes))
        price = buy_price(grid)
        prepared.settle(price, [battery_kw(price, values) for values in of_homes])
    began = time.monotonic()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    session = open_session("peer", listen=[endpoint])
    exchange = Exchange(session, homes)
    command = [sys.executable, __file__, "--endpoint", endpoint, "--agent"]
    agents = [subprocess.Popen([*command, agent], stdin=subprocess.PIPE) for agent in ("grid", *homes)]
    # Zenoh's calls wait for ever where an agent has died.
    watchdog = threading.Timer(options.timeout, give_up, (agents, options.timeout))
    watchdog.daemon = True
    watchdog.start()
    try:
        wait_for_agents(session, len(agents))
        played = []
        first = begin = 0.0
        for slot, observation in enumerate(observations):
            if slot == options.warm_up:
                begin = time.monotonic()
            played.append(exchange.play(slot, *observation))
            if slot == 0:
                first = time.monotonic()
        slots_s = options.slots / (time.monotonic() - begin)
    finally:
        for agent in agents:
            agent.communicate()
    watchdog.cancel()
    environment = Environment(options.homes)
    for price, commands, _, _ in played:
        environment.settle(price, commands)
    times = {
        "price": [row[2] for row in played[options.warm_up :]],
        "battery": [row[3] for row in played[options.warm_up :]],
    }
    figures = {
        f"{phase}_p{percent}_ms": 1e3 * float(np.percentile(values, percent))
        for phase, values in times.items()
        for percent in (50, 99)
    }
    report("bare Zenoh", options.homes, began, result(environment, first, slots_s), **figures)


def give_up(agents: list[subprocess.Popen[bytes]], timeout_s: float) -> None:
    """End this process and its agents."""
    for agent in agents:
        agent.kill()
    print(f"the market did not end within {timeout_s:g} s", file=sys.stderr, flush=True)
    os._exit(3)


def wait_for_agents(session: Any, count: int) -> None:
    """Wait until so many agents are connected."""
    alive: set[str] = set()
    complete = threading.Event()

    def on_token(sample: Any) -> None:
        alive.add(str(sample.key_expr))
        if len(alive) == count:
            complete.set()

    tokens = session.liveliness().declare_subscriber("market/alive/*", on_token, history=True)
    if not complete.wait(START_S):
        raise SystemExit(f"{len(alive)} of {count} agents connected within {START_S:g} s: {sorted(alive)}")
    tokens.undeclare()


if __name__ == "__main__":
    main()
