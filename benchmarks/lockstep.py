"""How fast whole markets run, one process an agent, beside what users would pick instead.

    python benchmarks/lockstep.py --peers ../shared/peers --rounds 5

A zengrid market is measured as its users run it: ``zengrid up``, journal on, at full speed. Every round runs all
systems one after the other, so that noise of the machine falls on all alike; medians of the rounds count, and of the
ratios within them.
"Bare Zenoh" exchanges the same number of messages between the same processes, as JSON through pydantic, and does
nothing else.

``--certs`` adds the same market over TLS, with certificates on both sides.

Peers need ``pip install helics mosaik mosaik-api-v3`` and the folder with their benchmarks; without ``--peers`` only
zengrid runs.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
import yaml

from zengrid.bus.market_client import MarketClient
from zengrid.bus.zenoh_session import HANDOVER, RUNTIME
from zengrid.errors import BusError
from zengrid.journal import Journal
from zengrid.scenario import load
from zengrid.testing import free_endpoint
from zengrid.wire.queries import Status

Row = dict[str, float]
WARM_SLOTS = 50
SECURED = "zengrid, certificates"
PEER_SLOTS = {3: 600, 10: 200, 30: 60}


def scenario_file(homes: int, folder: Path) -> str:
    """The paper's market with so many prosumers."""
    if homes == 3:
        return "paper"
    body = yaml.safe_load(load("paper").dump())
    body["homes"] = [{**body["homes"][i % 3], "id": f"p{i + 1}"} for i in range(homes)]
    path = folder / f"paper{homes}.yaml"
    path.write_text(yaml.safe_dump(body))
    return str(path)


def zengrid(homes: int, seconds: float, certs: Path | None = None) -> Row:
    """One run of ``zengrid up``, over TLS where there are certificates."""
    with tempfile.TemporaryDirectory() as name:
        folder, endpoint = Path(name), free_endpoint()
        scenario = scenario_file(homes, folder)
        command = [str(Path(sys.executable).with_name("zengrid")), "up", scenario, "--no-http", "--quiet"]
        # What decides is not measured here: rules, as the peers have.
        command += ["--policy", "conventional", "--grid-policy", "fixed"]
        command += ["--listen", endpoint, "--journal", str(folder / "journal.db"), "--logs", str(folder / "logs")]
        command += [] if certs is None else ["--certs", str(certs)]
        began = time.time()
        market = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            with MarketClient("main", endpoint, certs=certs, timeout_s=30) as client:
                warm = warmed_up(client)
                client.session.close()
            processes = [psutil.Process(market.pid), *psutil.Process(market.pid).children(recursive=True)]
            used_s, begin = -cpu_s(processes), time.monotonic()
            time.sleep(seconds)
            used_s += cpu_s(processes)
            measured_s = time.monotonic() - begin
            with MarketClient("main", endpoint, certs=certs, timeout_s=30) as client:
                status = client.control("status", homes=False)
                client.control("stop")
            _, said = market.communicate(timeout=30)
        finally:
            market.kill()
        if market.returncode:
            raise SystemExit(f"zengrid up failed: {said}")
        with Journal.open(folder / "journal.db", read_only=True) as journal:
            run = journal.run()
            times = [float(t) for block in run.blocks(homes=False) for t in block["settled_at"]]
        fallbacks = sum(agent.fallbacks for agent in status.agents)
        if fallbacks:
            raise SystemExit(f"{fallbacks} fallbacks at {homes} homes: this run measures deadlines, not speed")
        # Between the two looks of the operator, and without what joining and leaving cost.
        first, last = warm.totals.slots, status.totals.slots - 1
        latency = status.latency
        slots_s = (last - first) / (times[last] - times[first])
        return {
            "slots_s": slots_s,
            "cpu_ms": 1e3 * used_s / (slots_s * measured_s),
            "first_slot_s": times[0] - began,
            "price_p50_ms": latency.price_p50_ms,
            "price_p99_ms": latency.price_p99_ms,
            "battery_p50_ms": latency.battery_p50_ms,
            "battery_p99_ms": latency.battery_p99_ms,
            "commit_p50_ms": latency.commit_p50_ms,
        }


def warmed_up(client: MarketClient) -> Status:
    """How a market stands that has settled some slots; a clock that has just begun to listen may not answer yet."""
    until = time.monotonic() + 60
    while time.monotonic() < until:
        with contextlib.suppress(BusError):
            status = client.control("status", homes=False)
            if status.totals.slots >= WARM_SLOTS:
                return status
    raise SystemExit("the market has not begun within 60 s")


def cpu_s(processes: list[psutil.Process]) -> float:
    """CPU time of processes so far. [s]"""
    return float(sum(sum(process.cpu_times()[:2]) for process in processes))


class Peers:
    """The peers' own benchmarks, in a copy: they write beside themselves."""

    def __init__(self, source: Path, folder: Path) -> None:
        self.folder = folder / "peers"
        shutil.copytree(source, self.folder)
        subprocess.run(["chmod", "-R", "u+w", str(self.folder)], check=True)
        sys.path.insert(0, str(self.folder))

    def bare_zenoh(self, homes: int, seconds: float) -> Row:
        """Messages and nothing else."""
        command = [sys.executable, "bare_zenoh.py", "-n", str(homes), "--topo", "direct", "--codec", "json"]
        command += ["--clock", "fifo", "--agent", "fifo", "--secs", str(seconds)]
        results = self.folder / "lockstep_results.jsonl"
        results.unlink(missing_ok=True)
        environment = {**os.environ, RUNTIME: HANDOVER.format(threads=2)}
        subprocess.run(command, cwd=self.folder, check=True, stdout=subprocess.DEVNULL, env=environment)
        (run,) = json.loads(results.read_text())["res"]
        return {
            "slots_s": run["sps"],
            "price_p50_ms": run["p1"][0] / 1e3,
            "price_p99_ms": run["p1"][1] / 1e3,
            "battery_p50_ms": run["p2"][0] / 1e3,
            "battery_p99_ms": run["p2"][1] / 1e3,
        }

    def peer(self, module: str, homes: int, **settings: Any) -> Row:
        """HELICS or mosaik."""
        slots = PEER_SLOTS.get(homes, 60)
        common = {"n": homes, "slots": slots, "warm": max(10, slots // 10), "timeout": 60}
        here = Path.cwd()
        os.chdir(self.folder)
        try:
            run = importlib.import_module(module).one(argparse.Namespace(**common, **settings))
        finally:
            os.chdir(here)
        if "error" in run:
            return {}
        return {"slots_s": run["slots_s"], "first_slot_s": run["start_s"]}


def systems(peers: Peers | None, certs: Path | None, seconds: float) -> dict[str, Any]:
    """What is measured, by name."""
    all_of_them: dict[str, Any] = {"zengrid": lambda n: zengrid(n, seconds)}
    if certs is not None:
        all_of_them[SECURED] = lambda n: zengrid(n, seconds, certs)
    if peers is not None:
        helics = {"mode": "offset", "brokerx": "--globaltime", "onecore": False, "corex": ""}
        mosaik = {"how": "cmd", "eager": True, "nocache": False, "verbose": False}
        all_of_them |= {
            "bare Zenoh": lambda n: peers.bare_zenoh(n, seconds),
            "HELICS ipc": lambda n: peers.peer("helics_bench", n, core="ipc", **helics),
            "HELICS zmq": lambda n: peers.peer("helics_bench", n, core="zmq", **helics),
            "mosaik": lambda n: peers.peer("mosaik_bench", n, **mosaik),
        }
    return all_of_them


def median(rows: list[Row], key: str) -> float | None:
    """Median of one figure over the rounds that have it."""
    values = [row[key] for row in rows if key in row]
    return statistics.median(values) if values else None


def table(results: dict[int, dict[str, list[Row]]]) -> str:
    """Markdown."""

    def shown(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    lines = [
        "| homes | system | slots/s (min-max) | ratio | price p50 / p99 [ms] | battery p50 / p99 [ms] | 1st slot [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for homes, by_name in results.items():
        ours = by_name["zengrid"]
        for name, rows in by_name.items():
            speed = median(rows, "slots_s")
            if speed is None:
                lines.append(f"| {homes} | {name} | failed | | | | |")
                continue
            speeds = [row["slots_s"] for row in rows if row]
            phases = [
                f"{shown(median(rows, f'{phase}_p50_ms'), 2)} / {shown(median(rows, f'{phase}_p99_ms'), 2)}"
                for phase in ("price", "battery")
            ]
            # Of each round by itself: the machine changes its speed less within one than from one to the next.
            ratios = [mine["slots_s"] / its["slots_s"] for mine, its in zip(ours, rows, strict=True) if its]
            ratio = "" if name == "zengrid" else f"{statistics.median(ratios):.2f} x"
            lines.append(
                f"| {homes} | {name} | {speed:.0f} ({min(speeds):.0f}-{max(speeds):.0f}) | {ratio} | {phases[0]} | "
                f"{phases[1]} | {shown(median(rows, 'first_slot_s'), 2)} |"
            )
    return "\n".join(lines)


def price_of_certificates(homes: int, by_name: dict[str, list[Row]]) -> str:
    """What TLS costs, round by round: the machine's speed drifts, but hardly within one."""
    bare, secured = by_name["zengrid"], by_name[SECURED]
    told = [f"certificates, {homes} homes:"]
    units = {
        "slots_s": "slots/s",
        "cpu_ms": "ms CPU a slot",
        "price_p50_ms": "ms price",
        "battery_p50_ms": "ms battery",
    }
    for key, unit in units.items():
        ratio = statistics.median(after[key] / before[key] for before, after in zip(bare, secured, strict=True))
        values = f"{median(bare, key):.2f} -> {median(secured, key):.2f} {unit}"
        told.append(f"{values} ({100 * (ratio - 1):+.0f} %)")
    return "  ".join(told)


def main() -> None:
    """Measure, print the table, write the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--homes", type=int, nargs="+", default=[3, 10, 30])
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--seconds", type=float, default=3.0)
    options.add_argument("--peers", type=Path, help="folder with the peers' benchmarks")
    options.add_argument("--certs", action="store_true", help="measure zengrid with certificates, too")
    options.add_argument("--out", type=Path, default=Path("benchmarks/results/lockstep.json"))
    chosen = options.parse_args()
    results: dict[int, dict[str, list[Row]]] = {}
    with tempfile.TemporaryDirectory() as name:
        peers = Peers(chosen.peers.resolve(), Path(name)) if chosen.peers else None
        certs = Path(name) / "certs" if chosen.certs else None
        if certs is not None:
            ids = ",".join(f"p{i + 1}" for i in range(max(chosen.homes)))
            command = [sys.executable, "-m", "zengrid_cli", "certs", str(certs), "--ids", ids]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        for homes in chosen.homes:
            all_of_them = systems(peers, certs, chosen.seconds)
            results[homes] = {system: [] for system in all_of_them}
            for number in range(chosen.rounds):
                for system, run in all_of_them.items():
                    results[homes][system].append(run(homes))
                    speed = results[homes][system][-1].get("slots_s", 0.0)
                    print(f"round {number + 1}, {homes} prosumers, {system}: {speed:.0f} slots/s", file=sys.stderr)
    machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "python": platform.python_version()}
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(
        json.dumps({"machine": machine, "rounds": chosen.rounds, "results": results}, indent=1) + "\n"
    )
    print(table(results))
    if chosen.certs:
        for homes, by_name in results.items():
            print(price_of_certificates(homes, by_name))


if __name__ == "__main__":
    main()
