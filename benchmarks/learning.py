"""How soon agents reach the paper's figures, and how far from optimal they end: each seed, on days nobody has seen.

Run it on a quiet machine, one thread: ``python benchmarks/learning.py --seeds 5 --json learning.json``. The seeds are
trained side by side as by ``zengrid train``; every evaluation plays the policies kept so far on held-out days, and the
time that takes is not counted. Times are CPU-seconds of this process since before the first day, choice of policies
included; on a machine with nothing else to do they are the seconds on the wall.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from zengrid.learn.evaluation import Changes, Evaluation, Evaluator, Trained, reaches
from zengrid.learn.run import Plan, Report, Run, use_threads
from zengrid.learn.settings import Settings
from zengrid.policy.file import PolicyFile
from zengrid.scenario import load
from zengrid_cli.train import pairs


def main() -> None:
    """Train, evaluate, print a table, write JSON."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--scenario", default="paper")
    options.add_argument("--data", type=Path, help="folder with the scenario's measured data")
    options.add_argument("--soc-reset", choices=["daily", "never"])
    options.add_argument("--observation", choices=["public", "paper"], default="public")
    options.add_argument("--preset", default="fast")
    options.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="changes", help="a setting")
    options.add_argument("--seeds", type=int, default=5)
    options.add_argument("--first-seed", type=int, default=0)
    options.add_argument("--every", type=int, default=5, help="days between evaluations")
    options.add_argument("--days", type=int, default=64, help="held-out days")
    options.add_argument("--time-limit", type=float, help="of training [s]")
    options.add_argument("--no-leader", action="store_true", help="leave out the leader reference")
    options.add_argument("--out", type=Path, help="where to keep the policies (default: nowhere)")
    options.add_argument("--json", type=Path, help="where to write the results")
    chosen = options.parse_args()
    use_threads(1)
    with tempfile.TemporaryDirectory() as nowhere:
        found = measure(chosen, chosen.out or Path(nowhere))
    show(found)
    if chosen.json:
        chosen.json.write_text(json.dumps(found, indent=1))


def measure(chosen: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Train all seeds side by side; when each reached the figures, and where it ended."""
    scenario = load(chosen.scenario, data=chosen.data)
    if chosen.soc_reset:
        scenario = scenario.with_(soc_reset=chosen.soc_reset)
    seeds = tuple(range(chosen.first_seed, chosen.first_seed + chosen.seeds))
    evaluator = Evaluator.held_out(scenario, chosen.days)
    wall, cpu = time.perf_counter(), time.process_time()
    settings = Settings.preset(chosen.preset).with_(**pairs(chosen.changes))
    run = Run(folder, Plan((scenario,) * len(seeds), seeds, settings, chosen.observation, ""))
    aside = [0.0, 0.0]
    kept: dict[int, tuple[str, Changes]] = {}
    reached: dict[int, float] = {}
    curve = []

    def look(report: Report) -> None:
        """How the kept policies do on held-out days; off the clock."""
        start = (time.perf_counter(), time.process_time())
        spent = start[1] - cpu - aside[1]
        for place, seed in enumerate(seeds):
            trained = best(run, place)
            if place not in kept or kept[place][0] != trained.grid.version + trained.prosumers.version:
                changes = evaluator.evaluate_trained(trained, gaps=False).changes
                kept[place] = (trained.grid.version + trained.prosumers.version, changes)
            if reaches(kept[place][1]):
                reached.setdefault(seed, spent)
            else:
                reached.pop(seed, None)  # once for all, or not at all
        curve.append({"step": report.step, "cpu_s": spent, "reached": len(reached)})
        aside[0] += time.perf_counter() - start[0]
        aside[1] += time.process_time() - start[1]

    run.go(look, every=chosen.every, most_seconds=chosen.time_limit)
    wall, cpu = time.perf_counter() - wall - aside[0], time.process_time() - cpu - aside[1]
    ended = [evaluator.evaluate_trained(best(run, place)) for place in range(len(seeds))]
    leader = None if chosen.no_leader else evaluator.leader()
    profit = None if leader is None else leader.outcome.profit
    return {
        "scenario": scenario.name, "soc_reset": scenario.soc_reset, "observation": chosen.observation,
        "preset": " ".join([chosen.preset, *chosen.changes]), "steps": run.training.step, "wall_s": wall,
        "cpu_s": cpu, "curve": curve, "leader_profit": profit, "highest": seeds[run.highest],
        "seeds": {seed: row(seed, reached, e, profit) for seed, e in zip(seeds, ended, strict=True)},
    }  # fmt: skip


def best(run: Run, place: int) -> Trained:
    """The policies kept of one seed."""
    parts = (run.folder / f"best-{run.names(place)}-{part}.safetensors" for part in ("grid", "prosumers"))
    return Trained(*map(PolicyFile.load, parts))


def row(seed: int, reached: dict[int, float], e: Evaluation, leader: float | None) -> dict[str, Any]:
    """One seed, as plain values."""
    assert e.gap is not None
    return {
        "reached_cpu_s": reached.get(seed),
        "bill_percent": e.changes.bill.tolist(), "profit_percent": e.changes.profit,
        "reserve_percent": e.changes.reserve,
        "gap_percent": e.gap.percent.tolist(), "gap_dollars": e.gap.dollars.tolist(),
        "short_of_leader_percent": None if leader is None else 100.0 * (1.0 - e.agents.profit / leader),
    }  # fmt: skip


def show(found: dict[str, Any]) -> None:
    """A line for each seed, and one for the worst."""
    rows = found["seeds"]
    print(
        f"{found['scenario']}, soc_reset {found['soc_reset']}, observation {found['observation']}, preset "
        f"{found['preset']}: {len(rows)} seeds side by side, {found['steps']:,} vector steps, "
        f"{found['cpu_s']:.0f} CPU-s ({found['wall_s']:.0f} s on the wall)"
    )
    print(
        f"{'seed':>5} {'reached':>9} {'bills':>21} {'profit':>7} {'reserve':>8} {'largest gap':>12} {'grid short':>11}"
    )
    for name, one in rows.items():
        when, short = one["reached_cpu_s"], one["short_of_leader_percent"]
        bills = " ".join(f"{bill:+6.1f}" for bill in one["bill_percent"][:3])
        print(
            f"{name:>5} {'never' if when is None else f'{when:.0f} s':>9} {bills:>21} {one['profit_percent']:+7.1f} "
            f"{one['reserve_percent']:+8.1f} {max(one['gap_percent']):>10.1f} % "
            f"{'' if short is None else f'{short:+9.1f} %':>11}"
        )
    times = [one["reached_cpu_s"] for one in rows.values() if one["reached_cpu_s"] is not None]
    print(f"the paper's figures: {len(times)} of {len(rows)} seeds", end="")
    print(f", median after {median(times):.0f} CPU-s, the last after {max(times):.0f}" if times else "")
    gaps = np.array([one["gap_percent"] for one in rows.values()])
    print(f"largest gap of any home and seed: {gaps.max():.1f} % of its saving; median {np.median(gaps):.1f} %")
    print(f"of the highest rank, on the days by which policies are chosen: seed {found['highest']}")


if __name__ == "__main__":
    main()
