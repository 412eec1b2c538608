"""The market as a HELICS federation: one process for the environment, the grid agent, each home and the broker.

    python benchmarks/peers/helics_market.py --core ipc --homes 3

Needs ``pip install -r benchmarks/peers/requirements.txt``. Tuned as HELICS' documentation advises: three fixed times
within a slot (the environment at 0, the grid agent at a quarter, the homes at a half), no interruption between them,
one broker with ``--globaltime``. Cores: ``ipc`` (shared memory, the fastest here; one federation at a time on a
machine), ``zmq`` (the default of HELICS), ``tcpss``. Prints figures as JSON once the settlement equals zengrid's core.
"""

from __future__ import annotations

import argparse
import json
import random
import socket
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from agent_rules import battery_kw, buy_price

GRID_OFFSET, HOME_OFFSET = 0.25, 0.5
"""When within a slot of length 1 an agent acts."""


def main() -> None:
    """Run a federation, or one federate of it."""
    from same_market import peer_parser

    parser = peer_parser(__doc__, Path(__file__).name)
    parser.add_argument("--core", choices=["ipc", "zmq", "tcpss"], default="ipc")
    parser.add_argument("--role", help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--result", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role:
        run_federate(options)
    else:
        run_federation(options)


def run_federation(options: argparse.Namespace) -> None:
    """Start the broker and all federates, wait for them, and report."""
    from same_market import report

    spec = find_spec("helics")
    if spec is None or spec.origin is None:
        raise SystemExit("helics is missing: pip install -r benchmarks/peers/requirements.txt")
    # The binary itself: the command that pip installs is a Python wrapper, which starts more slowly.
    broker = Path(spec.origin).with_name("install") / "bin" / "helics_broker"
    port = free_ports()
    command = [str(broker), "-t", options.core, "-f", str(options.homes + 2), "--loglevel=no_print", "--globaltime"]
    command += [] if options.core == "ipc" else [f"--port={port}", f"--name=broker{port}"]
    began = time.monotonic()
    processes = []
    with tempfile.TemporaryDirectory(prefix="helics-market-") as name:
        result = Path(name) / "result.json"
        shared = [f"--{key.replace('_', '-')}={getattr(options, key)}" for key in ("core", "homes", "slots", "warm_up")]
        shared += [f"--port={port}", f"--result={result}"]
        try:
            processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
            roles = ["environment", "grid", *map(str, range(options.homes))]
            processes += [subprocess.Popen([sys.executable, __file__, "--role", role, *shared]) for role in roles]
            for process in processes:
                code = process.wait(max(0.1, began + options.timeout - time.monotonic()))
                if code:
                    raise SystemExit(f"a process of the federation ended with exit code {code}")
        except subprocess.TimeoutExpired:
            raise SystemExit(f"the federation did not end within {options.timeout:g} s") from None
        finally:
            for process in processes:
                process.kill()
                process.wait()
        report(f"HELICS {options.core}", options.homes, began, json.loads(result.read_text()))


def run_federate(options: argparse.Namespace) -> None:
    """One process of the federation."""
    import helics

    slots = options.warm_up + options.slots
    if options.role == "environment":
        options.result.write_text(json.dumps(environment(helics, options)))
    elif options.role == "grid":
        grid(helics, options, slots)
    else:
        home(helics, options, int(options.role), slots)
    helics.helicsCloseLibrary()


def environment(helics: Any, options: argparse.Namespace) -> dict[str, Any]:
    """Publish observations, take the decisions of the slot, settle."""
    from same_market import play_in_lockstep

    homes = range(options.homes)
    federate = create_federate(helics, options, "environment", 0.0)
    to_grid = helics.helicsFederateRegisterGlobalTypePublication(federate, "grid", "vector", "")
    to_homes = [helics.helicsFederateRegisterGlobalTypePublication(federate, f"home{i}", "vector", "") for i in homes]
    price = helics.helicsFederateRegisterSubscription(federate, "price", "")
    commands = [helics.helicsFederateRegisterSubscription(federate, f"command{i}", "") for i in homes]
    helics.helicsFederateEnterExecutingMode(federate)
    slot = 0

    def exchange(of_grid: list[float], of_homes: list[list[float]]) -> tuple[float, list[float]]:
        nonlocal slot
        helics.helicsPublicationPublishVector(to_grid, of_grid)
        for publication, observation in zip(to_homes, of_homes, strict=True):
            helics.helicsPublicationPublishVector(publication, observation)
        slot += 1
        helics.helicsFederateRequestTime(federate, float(slot))
        return helics.helicsInputGetDouble(price), [helics.helicsInputGetDouble(command) for command in commands]

    run = play_in_lockstep(options.homes, options.warm_up, options.slots, exchange)
    helics.helicsFederateDisconnect(federate)
    return run


def grid(helics: Any, options: argparse.Namespace, slots: int) -> None:
    """The grid agent: a price a slot."""
    federate = create_federate(helics, options, "grid", GRID_OFFSET)
    publication = helics.helicsFederateRegisterGlobalTypePublication(federate, "price", "double", "")
    observation = helics.helicsFederateRegisterSubscription(federate, "grid", "")
    helics.helicsFederateEnterExecutingMode(federate)
    for slot in range(slots):
        helics.helicsFederateRequestTime(federate, slot + GRID_OFFSET)
        helics.helicsPublicationPublishDouble(publication, buy_price(helics.helicsInputGetVector(observation)))
    helics.helicsFederateDisconnect(federate)


def home(helics: Any, options: argparse.Namespace, number: int, slots: int) -> None:
    """A home's agent: a command a slot."""
    federate = create_federate(helics, options, f"home{number}", HOME_OFFSET)
    publication = helics.helicsFederateRegisterGlobalTypePublication(federate, f"command{number}", "double", "")
    price = helics.helicsFederateRegisterSubscription(federate, "price", "")
    observation = helics.helicsFederateRegisterSubscription(federate, f"home{number}", "")
    helics.helicsFederateEnterExecutingMode(federate)
    for slot in range(slots):
        helics.helicsFederateRequestTime(federate, slot + HOME_OFFSET)
        command = battery_kw(helics.helicsInputGetDouble(price), helics.helicsInputGetVector(observation))
        helics.helicsPublicationPublishDouble(publication, command)
    helics.helicsFederateDisconnect(federate)


def create_federate(helics: Any, options: argparse.Namespace, name: str, offset: float) -> Any:
    """A value federate that is granted one time a slot."""
    info = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(info, options.core)
    address = "--broker_address=_ipc_broker" if options.core == "ipc" else f"--brokerport={options.port}"
    helics.helicsFederateInfoSetCoreInitString(info, f"{address} --federates=1 --loglevel=no_print")
    helics.helicsFederateInfoSetTimeProperty(info, helics.HELICS_PROPERTY_TIME_PERIOD, 1.0)
    if offset:
        helics.helicsFederateInfoSetTimeProperty(info, helics.HELICS_PROPERTY_TIME_OFFSET, offset)
    helics.helicsFederateInfoSetIntegerProperty(
        info, helics.HELICS_PROPERTY_INT_LOG_LEVEL, helics.HELICS_LOG_LEVEL_NO_PRINT
    )
    helics.helicsFederateInfoSetFlagOption(info, helics.HELICS_FLAG_UNINTERRUPTIBLE, True)
    return helics.helicsCreateValueFederate(name, info)


def free_ports() -> int:
    """The first of some TCP ports in a row that nobody uses: the broker hands out those that follow."""
    while True:
        first = random.randrange(25_000, 45_000, 200)
        if all(is_free(port) for port in (first, first + 1)):
            return first


def is_free(port: int) -> bool:
    """Whether nobody listens on a port of loopback."""
    with socket.socket() as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True


if __name__ == "__main__":
    main()
