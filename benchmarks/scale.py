"""What a slot costs from 10 to 10,000 homes, in a few fleets, journal on: ``python benchmarks/scale.py``.

A market is measured as its users run it: ``zengrid up`` at full speed without a page. ``homes`` are markets like the
scenario village, with so many homes in two fleets; ``village`` and ``city`` are those scenarios as they are. Wall time
depends on what else the machine does, CPU time of all processes of the market hardly.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import statistics
import sys
import tempfile
import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml

from zengrid.bus.market_client import MarketClient
from zengrid.journal import Journal
from zengrid.testing import free_endpoint

WARM_SLOTS = 48
"""Two days before it counts: profiles, the journal's first pages, and Python's caches."""
LARGE_HOMES = 100
"""From here on the linear part is fitted: below it the fixed cost of a slot's messages hides it."""


def scenario_file(homes: int, folder: Path) -> str:
    """A village of another size; consumer and facilities grow with it."""
    source = files("zengrid.scenario") / "builtin" / "village.yaml"
    body = yaml.safe_load(source.read_text(encoding="utf-8"))
    factor = homes / body["population"]["count"]
    body["population"]["count"] = homes
    body["fleets"] = 2
    for facility in body["facilities"]:
        for field, power in (("min_kw", 1), ("max_kw", 1), ("a", -1)):
            if field in facility:
                facility[field] *= factor**power
    body["consumers"][0]["scale"] *= factor
    body["name"] = f"village{homes}"
    path = folder / f"village{homes}.yaml"
    path.write_text(yaml.safe_dump(body))
    return str(path)


def measure(scenario: str, folder: Path, seconds: float) -> dict[str, float]:
    """One run of ``zengrid up``."""
    endpoint, journal = free_endpoint(), folder / "journal.db"
    words = ["up", scenario, "--no-http", "--quiet", "--listen", endpoint, "--journal", str(journal)]
    words += ["--logs", str(folder / "logs")]
    began = time.time()
    with (folder / "up.txt").open("w+") as output:
        up = psutil.Popen([sys.executable, "-m", "zengrid_cli", *words], stdout=output, stderr=output)
        try:
            with MarketClient("main", endpoint, timeout_s=60) as client:
                while (first := client.control("status", homes=False)).totals.slots < WARM_SLOTS:
                    time.sleep(0.05)
                processes = [up, *up.children(recursive=True)]
                before = cpu_s(processes)
                time.sleep(seconds)
                after = cpu_s(processes)
                status = client.control("status", homes=False)
                memory_mb = sum(process.memory_full_info().pss for process in processes) / 2**20
                client.control("stop")
            if up.wait(60):
                raise SystemExit(f"zengrid up {scenario} failed: {(folder / 'up.txt').read_text()}")
        finally:
            if up.poll() is None:
                up.kill()
    fallbacks = sum(agent.fallbacks for agent in status.agents)
    if fallbacks:
        print(f"{scenario}: {fallbacks} fallbacks: deadlines were missed on this machine", file=sys.stderr)
    with Journal.open(journal, read_only=True) as opened:
        run = opened.run()
        times = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
    start, end = first.totals.slots, status.totals.slots - 1
    log = Path(f"{journal}-wal")
    stored = journal.stat().st_size + (log.stat().st_size if log.exists() else 0)
    return {
        "slots_s": (end - start) / float(times[end] - times[start]),
        "cpu_ms_per_slot": 1e3 * (after - before) / (end - start),
        "memory_mb": memory_mb,
        "journal_bytes_per_slot": stored / len(times),
        "first_slot_s": float(times[0]) - began,
        "commit_p50_ms": status.latency.commit_p50_ms,
        "fallbacks": fallbacks,
    }


def cpu_s(processes: list[psutil.Process]) -> float:
    """CPU time of processes so far. [s]"""
    return float(sum(sum(process.cpu_times()[:2]) for process in processes))


def table(results: dict[str, list[dict[str, float]]]) -> str:
    """Markdown, medians of the rounds."""
    lines = [
        "| homes | slots/s (min-max) | CPU a slot [ms] | CPU a home [µs] | memory [MiB] | journal a slot [kB] |",
        "|---|---|---|---|---|---|",
    ]
    for name, rows in results.items():
        m = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
        speeds = [row["slots_s"] for row in rows]
        each_us = 1e3 * m["cpu_ms_per_slot"] / homes_of(name)
        lines.append(
            f"| {name} | {m['slots_s']:.0f} ({min(speeds):.0f}-{max(speeds):.0f}) | {m['cpu_ms_per_slot']:.2f} | "
            f"{each_us:.2f} | {m['memory_mb']:.0f} | {m['journal_bytes_per_slot'] / 1e3:.1f} |"
        )
    return "\n".join(lines)


def homes_of(name: str) -> int:
    """Homes of a row."""
    return {"village": 100, "city": 10_000}.get(name) or int(name)


def fit(results: dict[str, list[dict[str, float]]]) -> dict[str, float]:
    """CPU time of a slot as a fixed part and one that grows with the homes: least squares of relative deviations."""
    sizes = [name for name in results if name.isdecimal() and int(name) >= LARGE_HOMES]
    if len(sizes) < 3:
        return {}
    homes = np.array([int(name) for name in sizes], dtype=np.float64)
    cpu_ms = np.array([statistics.median(row["cpu_ms_per_slot"] for row in results[name]) for name in sizes])
    (fixed, each), *_ = np.linalg.lstsq(np.stack([1 / cpu_ms, homes / cpu_ms], axis=1), np.ones(len(sizes)), rcond=None)
    deviation = np.abs((fixed + each * homes) / cpu_ms - 1).max()
    return {"fixed_ms": float(fixed), "per_home_us": float(1e3 * each), "largest_deviation": float(deviation)}


def main() -> None:
    """Measure, print the table, write the figures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--homes", type=int, nargs="+", default=[10, 30, 100, 300, 1000, 3000, 10_000])
    options.add_argument("--scenarios", nargs="*", default=["village", "city"])
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--seconds", type=float, default=3.0)
    options.add_argument("--out", type=Path, default=Path("benchmarks/results/scale.json"))
    chosen = options.parse_args()
    results: dict[str, list[dict[str, float]]] = {}
    for number in range(chosen.rounds):
        for name in [*map(str, chosen.homes), *chosen.scenarios]:
            folder = Path(tempfile.mkdtemp(prefix="zengrid-scale-"))
            try:
                scenario = scenario_file(int(name), folder) if name.isdecimal() else name
                row = measure(scenario, folder, chosen.seconds)
            finally:
                shutil.rmtree(folder)
            results.setdefault(name, []).append(row)
            print(
                f"round {number + 1}, {name}: {row['slots_s']:.0f} slots/s, {row['cpu_ms_per_slot']:.2f} ms CPU a slot",
                file=sys.stderr,
                flush=True,
            )
    line = fit(results)
    machine: dict[str, Any] = {"cpus": os.cpu_count(), "platform": platform.platform()}
    machine |= {"python": platform.python_version()}
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(json.dumps({"machine": machine, "results": results, "fit": line}, indent=1) + "\n")
    print(table(results))
    if line:
        print(
            f"CPU a slot = {line['fixed_ms']:.2f} ms + {line['per_home_us']:.2f} µs a home, "
            f"to {100 * line['largest_deviation']:.0f} % from {LARGE_HOMES} homes on"
        )


if __name__ == "__main__":
    main()
