"""Runs a market at full speed while its processes are killed, stopped, added and removed at random, then audits it.

    python benchmarks/soak.py --minutes 30 --faults-per-minute 40 --seed 1

Claim: docs/measurements/endurance.md. Takes ``--minutes``; needs nothing.

The market is the one users run, ``zengrid up`` with its web page and spawner. Each fault is drawn from the seed; its
recovery time is read from the market's public slots: how long until the target takes part again. At the end every slot
has to be in the journal once, energy and money balanced, and as published; memory and file handles have to be flat, and
no process and no file left. Exit code 1 where any of this fails.
"""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from endurance.checks import check_files, check_growth, check_journal
from endurance.faults import SCENARIO_AGENTS, Fault, FaultInjector
from endurance.observer import Observer
from kit.market import UpMarket
from kit.rounds import markdown, shown
from kit.script import parse_options, script_parser, write_results
from zengrid.testing import free_port

SAMPLE_S = 5.0
"""How often memory and file handles are sampled. [s]"""


def main() -> int:
    """Run, audit, print the table, write the figures."""
    options = parse_options(make_parser(), {"minutes": 0.2, "faults_per_minute": 60.0})
    # However this process is asked to end, it takes its market with it.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    with tempfile.TemporaryDirectory(prefix="zengrid-soak-") as name:
        result = soak(Path(name), options)
        if result["findings"]:
            kept = Path(tempfile.mkdtemp(prefix="zengrid-soak-kept-"))
            shutil.copytree(Path(name) / "logs", kept / "logs")
            shutil.copy(Path(name) / "up.txt", kept)
            print(f"logs: {kept}", file=sys.stderr)
    show(result)
    write_results(options.out, seed=options.seed, deadline_s=options.deadline, **result)
    return 1 if result["findings"] else 0


def make_parser() -> argparse.ArgumentParser:
    """Options of this script."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--minutes", type=float, default=30.0, help="default: %(default)g")
    parser.add_argument("--seed", type=int, default=1, help="of the faults (default: %(default)s)")
    parser.add_argument("--faults-per-minute", type=float, default=20.0, help="default: %(default)g")
    parser.add_argument("--deadline", type=float, default=0.5, help="of the market [s] (default: %(default)g)")
    return parser


def soak(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """One market from its start to the audit."""
    began, port = time.monotonic(), free_port()
    with UpMarket("paper", folder, "--http", str(port), "--deadline", str(options.deadline)) as market:
        observer = Observer(market)
        try:
            faults, findings = run_faults(observer, port, options)
            findings += end_market(market)
        finally:
            left = observer.end_processes()
    minutes = (time.monotonic() - began) / 60.0
    slots, wrong = check_journal(market.journal, observer.slots)
    processes, grown = check_growth(observer.samples)
    return {
        "minutes": minutes,
        "slots": slots,
        "slots_published": len(observer.slots),
        "journal_mb": market.journal.stat().st_size / 2**20,
        "faults": len(faults),
        "findings": [*observer.findings, *findings, *left, *wrong, *check_files(folder, market.journal), *grown],
        "recovery": summarize(faults),
        "processes": processes,
        "each": [fault._asdict() for fault in faults],
    }


def run_faults(observer: Observer, port: int, options: argparse.Namespace) -> tuple[list[Fault], list[str]]:
    """Inflict faults until the time is up; returns them, and a line for each thing wrong."""
    market, rng, interval_s = observer.market, random.Random(options.seed), 60.0 / options.faults_per_minute
    faults: list[Fault] = []
    with market.client() as client:
        injector = FaultInjector(observer, client, f"http://127.0.0.1:{port}/v1/price", rng)
        following = client.follow(observer.on_slot)
        acting = {"grid", *SCENARIO_AGENTS}
        if not observer.wait_for_slot(lambda slot: acting <= slot.acted, 0.0) or not injector.wait_for_spawner():
            raise SystemExit(f"the market did not start:\n{market.printed()}")
        injector.wait_for_gateway()
        began = time.monotonic()
        due = sample_at = began
        while time.monotonic() < began + 60.0 * options.minutes:
            if time.monotonic() >= sample_at:
                observer.sample()
                sample_at = time.monotonic() + SAMPLE_S
            if time.monotonic() >= due:
                fault = injector.inflict(*injector.draw())
                faults.append(fault._replace(at_s=fault.at_s - began))
                injector.findings += report(faults[-1])
                # Pauses are random and fill the interval on average, so that faults keep step with nothing.
                due = max(due + interval_s * rng.uniform(0.5, 1.5), time.monotonic())
            if market.up.poll() is not None:
                return faults, [*injector.findings, f"zengrid up ended: {market.printed()[-2000:]}"]
            time.sleep(min(0.05, interval_s / 10))
        observer.sample()
        following.undeclare()
    return faults, injector.findings


def report(fault: Fault) -> list[str]:
    """Print a fault; a line where the market did not recover from it."""
    recovery = "NOT RECOVERED" if fault.recovery_s is None else f"{fault.recovery_s:6.2f} s"
    print(f"{fault.at_s:7.1f} s  {fault.kind:18} {fault.target:8} {recovery}", file=sys.stderr, flush=True)
    return [] if fault.recovery_s is not None else [f"{fault.kind} {fault.target} at {fault.at_s:.1f} s: not recovered"]


def end_market(market: UpMarket) -> list[str]:
    """Ask ``zengrid up`` to end; a line where it does not end well."""
    if market.up.poll() is not None:
        return []
    market.up.terminate()
    try:
        code = market.up.wait(60)
    except psutil.TimeoutExpired:
        return ["zengrid up did not end within 60 s"]
    return [f"zengrid up: exit code {code}: {market.printed()[-500:]}"] if code else []


def summarize(faults: Sequence[Fault]) -> list[dict[str, Any]]:
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


def show(result: dict[str, Any]) -> None:
    """Print the table, resources of processes, and what was found."""
    print(
        f"{result['faults']} faults in {result['minutes']:.1f} minutes, {result['slots']} slots, "
        f"journal {result['journal_mb']:.0f} MiB"
    )
    lines = [
        [
            row["kind"],
            str(row["faults"]),
            str(row["recovered"]),
            f"{shown(row['median_s'], 2)} / {shown(row['worst_s'], 2)}",
            f"{shown(row['pause_median_s'], 2)} / {shown(row['pause_worst_s'], 2)}",
        ]
        for row in result["recovery"]
    ]
    columns = ["fault", "times", "recovered", "recovery median / worst [s]"]
    print(markdown([*columns, "longest time without a slot, median / worst [s]"], lines))
    for row in result["processes"]:
        print(
            f"{row['process']:16} memory {row['memory_mb_first']:6.1f} -> {row['memory_mb_last']:6.1f} MiB, "
            f"handles {row['handles_first']:.0f} -> {row['handles_last']:.0f}"
        )
    for finding in result["findings"]:
        print(f"FOUND: {finding}")


if __name__ == "__main__":
    sys.exit(main())
