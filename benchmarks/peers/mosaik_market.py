"""The market as a mosaik scenario: one process for the scheduler, the environment, the grid agent and each home.

    python benchmarks/peers/mosaik_market.py --homes 3

Needs ``pip install -r benchmarks/peers/requirements.txt``. mosaik starts every simulator as a process of its own and
speaks JSON over TCP with it. Within a time step data flows from the environment to the grid agent and the homes, and
from the grid agent to the homes; decisions reach the environment by time-shifted connections, so it settles at the next
step. Stepping is eager (``lazy_stepping=False``), which is faster here than the default. Prints figures as JSON once
the settlement equals zengrid's core.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import threading
import time
import warnings
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil

from agent_rules import battery_kw, buy_price

# ``--help`` works without mosaik.
Simulator: Any = import_module("mosaik_api_v3").Simulator if find_spec("mosaik_api_v3") else object


def meta(model: str, params: list[str], attributes: list[str]) -> dict[str, Any]:
    """Description of a simulator that steps once a slot, as mosaik wants it."""
    described = {"public": True, "params": params, "attrs": attributes}
    return {"api_version": "3.0", "type": "time-based", "models": {model: described}}


class EnvironmentSimulator(Simulator):
    """Gives observations; settles the decisions of the slot before."""

    def __init__(self) -> None:
        super().__init__(meta("Environment", [], []))

    def init(self, sid: str, time_resolution: float, **settings: Any) -> dict[str, Any]:
        """Learn the number of homes and slots, and where to write the result."""
        from same_market import Environment

        self.homes, self.warm_up, self.slots = settings["homes"], settings["warm_up"], settings["slots"]
        self.result_file = Path(settings["result"])
        self.environment = Environment(self.homes)
        described = self.meta["models"]["Environment"]
        described["attrs"] = ["grid", "price", "command", *(f"home{i}" for i in range(self.homes))]
        return dict(self.meta)

    def create(self, num: int, model: str) -> list[dict[str, str]]:
        """The one environment."""
        return [{"eid": "environment", "type": model}]

    def step(self, time_: int, inputs: dict[str, Any], max_advance: int) -> int:
        """Settle what was decided at the time before, and observe."""
        if time_ > 0:
            decided = inputs["environment"]
            (price,) = decided["price"].values()
            by_home = {int(source.partition(".home")[2]): value for source, value in decided["command"].items()}
            self.environment.settle(price, [by_home[i] for i in range(self.homes)])
            if time_ == 1:
                self.first = time.monotonic()
            if time_ == self.warm_up:
                self.begin = time.monotonic()
            if time_ == self.warm_up + self.slots:
                self.finish()
        self.to_grid, self.to_homes = self.environment.observe()
        return time_ + 1

    def finish(self) -> None:
        """Write the result."""
        from same_market import result

        slots_s = self.slots / (time.monotonic() - self.begin)
        self.result_file.write_text(json.dumps(result(self.environment, self.first, slots_s)))

    def get_data(self, outputs: dict[str, list[str]]) -> dict[str, Any]:
        """Observations of this slot."""
        wanted = outputs.get("environment", [])
        data = {name: self.to_grid if name == "grid" else self.to_homes[int(name[4:])] for name in wanted}
        return {"environment": data}


class AgentSimulator(Simulator):
    """A simulator with one agent, which makes one decision a slot."""

    def create(self, num: int, model: str, **params: Any) -> list[dict[str, str]]:
        """The one agent."""
        self.entity = f"home{params['number']}" if params else "grid"
        return [{"eid": self.entity, "type": model}]

    def get_data(self, outputs: dict[str, list[str]]) -> dict[str, Any]:
        """The decision of this slot."""
        return {self.entity: dict.fromkeys(outputs[self.entity], self.decision)}


class GridSimulator(AgentSimulator):
    """The grid agent."""

    def __init__(self) -> None:
        super().__init__(meta("Grid", [], ["observation", "price"]))

    def step(self, time_: int, inputs: dict[str, Any], max_advance: int) -> int:
        """Set the price."""
        (observation,) = inputs[self.entity]["observation"].values()
        self.decision = buy_price(observation)
        return time_ + 1


class HomeSimulator(AgentSimulator):
    """The agent of a home."""

    def __init__(self) -> None:
        super().__init__(meta("Home", ["number"], ["observation", "price", "command"]))

    def step(self, time_: int, inputs: dict[str, Any], max_advance: int) -> int:
        """Command the battery."""
        (price,) = inputs[self.entity]["price"].values()
        (observation,) = inputs[self.entity]["observation"].values()
        self.decision = battery_kw(price, observation)
        return time_ + 1


SIMULATORS = {"Environment": EnvironmentSimulator, "Grid": GridSimulator, "Home": HomeSimulator}


def run_world(homes: int, warm_up: int, slots: int, result: Path) -> None:
    """Start all simulators, connect them, and step through the slots."""
    import mosaik
    from loguru import logger

    logger.remove()
    warnings.simplefilter("ignore")
    names = ["Environment", "Grid", *(f"Home{i}" for i in range(homes))]
    command = f"%(python)s {Path(__file__).resolve()} --simulator {{}} %(addr)s"
    config = {name: {"cmd": command.format(name.rstrip("0123456789"))} for name in names}
    world = mosaik.World(config, mosaik_config={"start_timeout": 60, "stop_timeout": 10})
    settings = {"homes": homes, "warm_up": warm_up, "slots": slots, "result": str(result)}
    environment = world.start("Environment", **settings).Environment()
    grid = world.start("Grid").Grid()
    world.connect(environment, grid, ("grid", "observation"))
    world.connect(grid, environment, "price", time_shifted=True, initial_data={"price": 0.0})
    for number in range(homes):
        home = world.start(f"Home{number}").Home(number=number)
        world.connect(environment, home, (f"home{number}", "observation"))
        world.connect(grid, home, "price")
        world.connect(home, environment, "command", time_shifted=True, initial_data={"command": 0.0})
    world.run(until=warm_up + slots + 1, print_progress=False, lazy_stepping=False)


def main() -> None:
    """Run the world and report."""
    from same_market import peer_parser, report

    options = peer_parser(__doc__, Path(__file__).name).parse_args()
    if find_spec("mosaik") is None:
        raise SystemExit("mosaik is missing: pip install -r benchmarks/peers/requirements.txt")
    with tempfile.TemporaryDirectory(prefix="mosaik-market-") as name:
        result = Path(name) / "result.json"
        began = time.monotonic()
        # mosaik waits for ever where a simulator has died, so it runs in a thread that may be left behind.
        world = threading.Thread(
            target=run_world, args=(options.homes, options.warm_up, options.slots, result), daemon=True
        )
        world.start()
        world.join(options.timeout)
        if world.is_alive():
            print(f"mosaik did not end within {options.timeout:g} s", file=sys.stderr, flush=True)
            for simulator in psutil.Process().children(recursive=True):
                simulator.kill()
            os._exit(1)  # not even an ordinary exit ends mosaik's event loop
        if not result.exists():
            raise SystemExit("mosaik ended without a result")
        report("mosaik", options.homes, began, json.loads(result.read_text()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--simulator"]:
        import mosaik_api_v3

        _, _, simulator, *sys.argv[1:] = sys.argv
        mosaik_api_v3.start_simulation(SIMULATORS[simulator]())
    else:
        main()
