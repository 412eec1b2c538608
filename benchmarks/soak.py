"""Runs a market at full speed while its processes are killed, stopped, added and removed at random, then audits it.

    python benchmarks/soak.py --minutes 30 --faults-per-minute 20 --seed 1

The market is the one users run, ``zengrid up`` with its web page and spawner. Each fault is drawn from the seed; its
recovery time is what the market's public slots show: how long until whoever was hit takes part again. At the end:
every slot once, energy and money balanced, nobody was told of a slot that the journal does not hold, memory and file
handles flat, no process and no file left. Exit code 1 where any of this fails.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from urllib.error import URLError
from urllib.request import urlopen

import psutil

from zengrid.bus.market_client import MarketClient
from zengrid.errors import ZengridError
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.scenario import HomeSpec
from zengrid.testing import free_endpoint
from zengrid.wire.codec import decode
from zengrid.wire.slots import PublicSlot
from zengrid.wire.spawner_queries import SpawnRequest, StopRequest

RECOVERY_S = 60.0
"""A fault from which the market has not recovered by then counts as a failure."""
KILLS_A_MINUTE = 3
"""How often one process may be killed: ``zengrid up`` gives up one that fails six times within a minute."""
SPAWNED = ("s1", "s2", "s3")
SCENARIO_AGENTS = ("p1", "p2", "p3")
LOOK_S = 5.0
"""How often memory and file handles are looked at."""
GROWTH = 1.15, 8.0
"""Most growth of a process that counts as flat, from the first quarter of the run to the last: factor, and MiB or
handles."""


class Heard(NamedTuple):
    """A public slot as it came."""

    at: float
    position: int
    buy_price: float
    demand_kw: float
    acted: frozenset[str]
    everyone: frozenset[str]


class Fault(NamedTuple):
    """One fault and what came of it."""

    kind: str
    target: str
    at_s: float
    recovery_s: float | None
    pause_s: float
    """longest time without a new slot, from the fault until the recovery"""


class Soak:
    """One market, and everything that is done to it."""

    def __init__(self, folder: Path, minutes: float, faults_per_minute: float, seed: int, deadline_s: float) -> None:
        self.folder = folder
        self.minutes = minutes
        self.interval_s = 60.0 / faults_per_minute
        self.random = random.Random(seed)
        self.endpoint = free_endpoint()
        self.journal = folder / "journal.db"
        self.port = int(free_endpoint().rpartition(":")[2])
        words = ["up", "paper", "--listen", self.endpoint, "--journal", str(self.journal), "--http", str(self.port)]
        words += ["--logs", str(folder / "logs"), "--quiet", "--deadline", str(deadline_s)]
        self.output = folder / "up.txt"
        with self.output.open("w") as output:
            self.up = psutil.Popen(
                [sys.executable, "-m", "zengrid_cli", *words], stdout=output, stderr=output, start_new_session=True
            )
        self.heard: list[Heard] = []
        self.changed = threading.Condition()
        self.seen: dict[int, psutil.Process] = {}
        self.samples: dict[str, list[tuple[float, float, int]]] = defaultdict(list)
        self.kills: dict[str, list[float]] = defaultdict(list)
        self.faults: list[Fault] = []
        self.findings: list[str] = []

    # ---------------------------------------------------------------- looking

    def on_slot(self, payload: bytes) -> None:
        """Note each slot that everybody is told of."""
        slot = decode(PublicSlot, payload)
        acted = frozenset(slot.acted)
        with self.changed:
            if self.heard and slot.position <= self.heard[-1].position:
                if slot.position < self.heard[-1].position:
                    self.findings.append(f"slot {slot.position} was published after {self.heard[-1].position}")
                return
            everyone = acted | frozenset(slot.fallback)
            self.heard.append(Heard(time.monotonic(), slot.position, slot.buy_price, slot.demand_kw, acted, everyone))
            self.changed.notify_all()

    def wait(self, wanted: Callable[[Heard], bool], since: float) -> bool:
        """Wait for a public slot, settled after a moment, that looks as wanted."""

        def arrived() -> bool:
            return bool(self.heard) and self.heard[-1].at > since and wanted(self.heard[-1])

        with self.changed:
            return self.changed.wait_for(arrived, RECOVERY_S)

    def processes(self) -> dict[str, psutil.Process]:
        """All processes of the market by title; those of a spawner are called by their home."""
        found = {}
        try:
            for child in self.up.children(recursive=True):
                self.seen[child.pid] = child
                try:
                    found[" ".join(child.cmdline()).strip().removeprefix("zengrid ")] = child
                except psutil.Error:
                    continue
        except psutil.NoSuchProcess:
            pass
        return found

    def process(self, title: str) -> psutil.Process:
        """A process that runs, waited for where it is being started again."""
        until = time.monotonic() + RECOVERY_S
        while time.monotonic() < until:
            for name, process in self.processes().items():
                if name == title or name.endswith(f" {title}"):
                    return process
            time.sleep(0.05)
        raise RuntimeError(f"{title} does not run: {sorted(self.processes())}")

    def sample(self) -> None:
        """Memory [MiB] and file handles of every process."""
        for title, process in {"up": self.up, **self.processes()}.items():
            try:
                with process.oneshot():
                    pss = process.memory_full_info().pss / 2**20
                    self.samples[title].append((time.monotonic(), pss, process.num_fds()))
            except psutil.Error:
                continue

    # ---------------------------------------------------------------- faults

    def draw(self) -> tuple[str, str]:
        """The next fault: kinds with weights, and a target that was not killed too often lately."""
        spawned = self.spawned()
        while True:
            kinds = {
                "kill agent": 5.0,
                "stop agent": 4,
                "kill grid": 2,
                "stop grid": 1,
                "kill clock": 3,
                "stop clock": 2,
            }
            kinds |= {"kill gateway": 1, "kill spawner": 0.5, "kill several": 1, "add home": 3, "remove home": 2}
            kinds["kill spawned home"] = 2
            (kind,) = self.random.choices(list(kinds), list(kinds.values()))
            targets: list[str] = {
                "kill agent": list(SCENARIO_AGENTS),
                "stop agent": [*SCENARIO_AGENTS, *spawned],
                "kill grid": ["grid"],
                "stop grid": ["grid"],
                "kill clock": ["clock"],
                "stop clock": ["clock"],
                "kill gateway": ["gateway"],
                "kill spawner": ["spawner"],
                "kill several": ["clock"],
                "add home": [name for name in SPAWNED if name not in spawned],
                "remove home": spawned,
                "kill spawned home": spawned,
            }[kind]
            if not targets:
                continue
            target = self.random.choice(targets)
            recent = [at for at in self.kills[target] if at > time.monotonic() - 60.0]
            if not kind.startswith("kill") or len(recent) < KILLS_A_MINUTE:
                return kind, target

    def spawned(self) -> list[str]:
        """Homes that a spawner runs now."""
        return sorted(name for name in SPAWNED if any(t.endswith(f" {name}") for t in self.processes()))

    def kill(self, *titles: str) -> None:
        """SIGKILL."""
        for title in titles:
            process = self.process(title)
            self.kills[title].append(time.monotonic())
            process.kill()

    def inflict(self, kind: str, target: str, client: MarketClient) -> Fault:
        """Do it, and wait until whoever was hit takes part again."""
        mark = len(self.heard)
        at = time.monotonic()
        since = at
        agents = frozenset({"grid", *SCENARIO_AGENTS, *self.spawned()})

        def acts(slot: Heard) -> bool:
            return target in slot.acted

        if kind in ("kill agent", "kill grid", "kill spawned home"):
            self.kill(target)
            recovered = self.wait(lambda slot: target not in slot.acted, since) and self.wait(acts, time.monotonic())
        elif kind == "kill several":
            self.kill("clock", "grid", self.random.choice(SCENARIO_AGENTS))
            recovered = self.wait(lambda slot: agents <= slot.acted, time.monotonic())
        elif kind.startswith("stop"):
            process = self.process(target)
            seconds = self.random.uniform(0.2, 6.0 if kind == "stop agent" else 3.0)
            process.suspend()
            time.sleep(seconds)
            process.resume()
            since = time.monotonic()
            recovered = self.wait(acts if target != "clock" else lambda slot: agents <= slot.acted, since)
        elif kind == "kill clock":
            self.kill("clock")
            recovered = self.wait(lambda slot: agents <= slot.acted, time.monotonic())
        elif kind == "kill gateway":
            self.kill("gateway")
            recovered = self.gateway_answers()
        elif kind == "kill spawner":
            lost = self.spawned()
            self.kill("spawner")
            recovered = self.spawner_back(client)
            # Its homes are still in the market, served by the fallback: new processes take them over.
            for home in lost:
                recovered = self.add(home, client) and recovered
        elif kind == "add home":
            recovered = self.add(target, client)
        else:
            self.ask(client, lambda name: client.stop_process(name, StopRequest(id=target)))
            recovered = self.wait(lambda slot: target not in slot.everyone, time.monotonic())
        now = time.monotonic()
        times = [at, *(slot.at for slot in self.heard[mark:] if slot.at <= now), now]
        pause_s = max(after - before for before, after in pairwise(times))
        return Fault(kind, target, at, now - since if recovered else None, pause_s)

    def add(self, home: str, client: MarketClient) -> bool:
        """Have a spawner start a home, and see it act."""
        body = {"id": home, "pv_kw": 4.0, "battery": {"capacity_kwh": 8.0}}
        self.ask(client, lambda name: client.spawn(name, SpawnRequest(home=HomeSpec.model_validate(body))))
        return self.wait(lambda slot: home in slot.acted, time.monotonic())

    def ask(self, client: MarketClient, question: Callable[[str], Any]) -> None:
        """Ask the spawner, again where it or the clock was just being started again."""
        until = time.monotonic() + RECOVERY_S
        while True:
            try:
                question(client.spawners()[0].spawner)
                return
            except (ZengridError, IndexError) as error:
                if time.monotonic() > until:
                    self.findings.append(f"spawner: {error}")
                    return
                time.sleep(0.1)

    def spawner_back(self, client: MarketClient) -> bool:
        """Wait until a spawner answers."""
        until = time.monotonic() + RECOVERY_S
        while time.monotonic() < until:
            if client.spawners():
                return True
            time.sleep(0.05)
        return False

    def gateway_answers(self) -> bool:
        """Wait until the price can be had over HTTP."""
        until = time.monotonic() + RECOVERY_S
        while time.monotonic() < until:
            try:
                with urlopen(f"http://127.0.0.1:{self.port}/v1/price", timeout=5) as reply:
                    return bool(reply.status == 200)
            except (URLError, OSError):
                time.sleep(0.05)
        return False

    # ---------------------------------------------------------------- the run

    def run(self) -> None:
        """Faults until the time is up, then the end of the market."""
        with MarketClient("main", self.endpoint, timeout_s=30.0) as client:
            following = client.follow(self.on_slot)
            if not self.wait(lambda slot: {"grid", *SCENARIO_AGENTS} <= slot.acted, 0.0) or not self.spawner_back(
                client
            ):
                raise SystemExit(f"the market did not start: {self.output.read_text()}")
            self.gateway_answers()
            began = time.monotonic()
            end, due, look = began + 60.0 * self.minutes, began, began
            while time.monotonic() < end:
                if time.monotonic() >= look:
                    self.sample()
                    look = time.monotonic() + LOOK_S
                if time.monotonic() >= due:
                    kind, target = self.draw()
                    fault = self.inflict(kind, target, client)
                    self.faults.append(fault._replace(at_s=fault.at_s - began))
                    shown = "NOT RECOVERED" if fault.recovery_s is None else f"{fault.recovery_s:6.2f} s"
                    print(f"{fault.at_s - began:7.1f} s  {kind:18} {target:8} {shown}", file=sys.stderr, flush=True)
                    if fault.recovery_s is None:
                        self.findings.append(f"{kind} {target} at {fault.at_s - began:.1f} s: not recovered")
                    # A random pause, on average the rest of the interval: faults do not come in step with anything.
                    due = max(due + self.interval_s * self.random.uniform(0.5, 1.5), time.monotonic())
                if self.up.poll() is not None:
                    self.findings.append(f"zengrid up ended: {self.output.read_text()[-2000:]}")
                    return
                time.sleep(min(0.05, self.interval_s / 10))
            self.sample()
            following.undeclare()
        self.up.terminate()
        try:
            code = self.up.wait(60)
            if code:
                self.findings.append(f"zengrid up: exit code {code}: {self.output.read_text()[-500:]}")
        except psutil.TimeoutExpired:
            self.findings.append("zengrid up did not end within 60 s")

    def close(self) -> None:
        """Nothing may be left, whatever happened."""
        left = [process for process in self.seen.values() if alive(process)]
        psutil.wait_procs(left, timeout=5)
        for process in left:
            if alive(process):
                self.findings.append(f"process {process.pid} is left: {' '.join(process.cmdline())}")
                process.kill()
        if self.up.poll() is None:
            self.up.kill()

    # ---------------------------------------------------------------- afterwards

    def audit(self) -> int:
        """Check the journal, by itself and against what was published; returns its slots."""
        with Journal.open(self.journal, read_only=True) as journal:
            if len(journal.runs()) != 1:
                self.findings.append(f"the journal holds {len(journal.runs())} runs, not 1")
            run = journal.run()
            self.findings += audit(run)
            settled = {}
            for block in run.blocks(homes=False):
                columns = (block[name].tolist() for name in ("position", "buy_price", "demand_kw"))
                settled.update({int(p): (price, demand) for p, price, demand in zip(*columns, strict=True)})
        for slot in self.heard:
            if settled.get(slot.position) != (slot.buy_price, slot.demand_kw):
                self.findings.append(f"slot {slot.position} was published as {slot}, not as settled")
        return len(settled)

    def flat(self) -> list[dict[str, Any]]:
        """First and last quarter of what each process took."""
        rows = []
        end = max((rows_[-1][0] for rows_ in self.samples.values()), default=0.0)
        begin = min((rows_[0][0] for rows_ in self.samples.values()), default=0.0)
        quarter = (end - begin) / 4
        for title, rows_ in sorted(self.samples.items()):
            first = [row for row in rows_ if row[0] <= begin + quarter]
            last = [row for row in rows_ if row[0] >= end - quarter]
            if not first or not last:
                continue
            row: dict[str, Any] = {"process": title, "looks": len(rows_)}
            for i, what in ((1, "memory_mb"), (2, "handles")):
                before, after = (statistics.median(r[i] for r in part) for part in (first, last))
                row |= {f"{what}_first": before, f"{what}_last": after}
                if after > before * GROWTH[0] + GROWTH[1]:
                    self.findings.append(f"{title}: {what} grew from {before:.0f} to {after:.0f}")
            rows.append(row)
        return rows

    def leftovers(self) -> None:
        """Beside the journal and the logs there may be nothing."""
        for path in self.folder.iterdir():
            if path.name not in ("journal.db", "journal.db-wal", "journal.db-shm", "logs", "up.txt"):
                self.findings.append(f"file {path.name} is left")
        log = Path(f"{self.journal}-wal")
        if log.exists() and log.stat().st_size:
            self.findings.append(f"{log.name} is left with {log.stat().st_size} bytes")


def alive(process: psutil.Process) -> bool:
    """Whether it runs (a zombie does not)."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def summary(faults: list[Fault]) -> list[dict[str, Any]]:
    """Recovery times for each kind of fault."""
    by_kind: dict[str, list[Fault]] = defaultdict(list)
    for fault in faults:
        by_kind[fault.kind].append(fault)
    rows = []
    for kind, same in sorted(by_kind.items()):
        times = [fault.recovery_s for fault in same if fault.recovery_s is not None]
        rows.append(
            {
                "kind": kind,
                "faults": len(same),
                "recovered": len(times),
                "median_s": statistics.median(times) if times else None,
                "worst_s": max(times, default=None),
                "pause_median_s": statistics.median(fault.pause_s for fault in same),
                "pause_worst_s": max(fault.pause_s for fault in same),
            }
        )
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Markdown."""

    def shown(value: float | None) -> str:
        return "-" if value is None else f"{value:.2f}"

    lines = [
        "| fault | times | recovered | recovery median / worst [s] | longest time without a slot, median / worst [s] |",
        "|---|---|---|---|---|",
    ]
    lines += [
        f"| {row['kind']} | {row['faults']} | {row['recovered']} | {shown(row['median_s'])} / "
        f"{shown(row['worst_s'])} | {shown(row['pause_median_s'])} / {shown(row['pause_worst_s'])} |"
        for row in rows
    ]
    return "\n".join(lines)


def main() -> int:
    """Run, audit, print the table, write the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--minutes", type=float, default=30.0)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--faults-per-minute", type=float, default=20.0)
    options.add_argument("--deadline", type=float, default=0.5, help="the market's; default: %(default)s s")
    options.add_argument("--out", type=Path, default=Path("benchmarks/results/soak.json"))
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory(prefix="zengrid-soak-") as name:
        soak = Soak(Path(name), chosen.minutes, chosen.faults_per_minute, chosen.seed, chosen.deadline)
        # However this process is asked to end, it takes its market with it.
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
        began = time.monotonic()
        try:
            soak.run()
        finally:
            soak.close()
        seconds = time.monotonic() - began
        slots = soak.audit()
        soak.leftovers()
        processes = soak.flat()
        journal_mb = soak.journal.stat().st_size / 2**20
        if soak.findings:
            kept = Path(tempfile.mkdtemp(prefix="zengrid-soak-kept-"))
            subprocess.run(["cp", "-r", f"{name}/logs", f"{name}/up.txt", str(kept)], check=False)
            print(f"logs: {kept}", file=sys.stderr)
    rows = summary(soak.faults)
    result = {
        "machine": {"cpus": os.cpu_count(), "platform": platform.platform(), "python": platform.python_version()},
        "minutes": seconds / 60,
        "seed": chosen.seed,
        "deadline_s": chosen.deadline,
        "slots": slots,
        "slots_heard": len(soak.heard),
        "journal_mb": journal_mb,
        "faults": len(soak.faults),
        "findings": soak.findings,
        "recovery": rows,
        "processes": processes,
        "each": [fault._asdict() for fault in soak.faults],
    }
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"{len(soak.faults)} faults in {seconds / 60:.1f} minutes, {slots} slots, journal {journal_mb:.0f} MiB")
    print(table(rows))
    for row in processes:
        print(
            f"{row['process']:16} memory {row['memory_mb_first']:6.1f} -> {row['memory_mb_last']:6.1f} MiB, "
            f"handles {row['handles_first']:.0f} -> {row['handles_last']:.0f}"
        )
    for finding in soak.findings:
        print(f"FOUND: {finding}")
    return 1 if soak.findings else 0


if __name__ == "__main__":
    sys.exit(main())
