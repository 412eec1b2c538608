"""Time until agents reach the paper's figures, and their distance from the optimum at the end, on held-out days.

    python benchmarks/learning.py --seeds 5

Claims: docs/measurements/learning.md.
Takes 2 minutes for five seeds of the preset ``fast`` and the leader reference; needs torch.
Run it on a machine with nothing else to do; it uses one thread.

Seeds are trained side by side as by ``zengrid train``. Every evaluation plays the policies kept so far on held-out
days, and does not count as training time. Times are CPU-seconds of this process since before the first day, choice of
policies included; on an idle machine they are seconds on the wall.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from kit.script import parse_options, script_parser, write_results
from zengrid.command_line.assignments import parse_assignments
from zengrid.learn.evaluation import Changes, Evaluation, Evaluator, Trained, reaches
from zengrid.learn.run import Plan, Report, Run, use_threads
from zengrid.learn.settings import Settings
from zengrid.policy.file import PolicyFile
from zengrid.scenario import load


def main() -> None:
    """Train, evaluate, print a table, write the figures."""
    quick = {"seeds": 1, "changes": ["steps=24"], "days": 4, "no_leader": True}
    options = parse_options(make_parser(), quick)
    use_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        results = measure(options, options.policies or Path(folder))
    show(results)
    write_results(options.out, **results)


def make_parser() -> argparse.ArgumentParser:
    """Options of this script."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--scenario", default="paper")
    parser.add_argument("--data", type=Path, help="folder with the scenario's measured data")
    parser.add_argument("--soc-reset", choices=["daily", "never"])
    parser.add_argument("--observation", choices=["public", "paper"], default="public")
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="changes", help="a setting")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--every", type=int, default=5, help="days between evaluations (default: %(default)s)")
    parser.add_argument("--days", type=int, default=64, help="held-out days (default: %(default)s)")
    parser.add_argument("--time-limit", type=float, help="of training [s]")
    parser.add_argument("--no-leader", action="store_true", help="leave out the leader reference")
    parser.add_argument("--policies", type=Path, metavar="FOLDER", help="where to keep the policies (default: nowhere)")
    return parser


def measure(options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Train all seeds side by side; when each reached the figures, and where it ended."""
    scenario = load(options.scenario, data=options.data)
    if options.soc_reset:
        scenario = scenario.with_(soc_reset=options.soc_reset)
    seeds = tuple(range(options.first_seed, options.first_seed + options.seeds))
    evaluator = Evaluator.held_out(scenario, options.days)
    settings = Settings.preset(options.preset).with_(**parse_assignments(options.changes))
    stopwatch = Stopwatch()
    run = Run(folder, Plan((scenario,) * len(seeds), seeds, settings, options.observation, ""))
    progress = Progress(run, seeds, evaluator, stopwatch)
    run.go(progress.evaluate, every=options.every, most_seconds=options.time_limit)
    wall_s, cpu_s = stopwatch.read()
    ended = [evaluator.evaluate_trained(best(run, place)) for place in range(len(seeds))]
    leader = None if options.no_leader else evaluator.leader()
    profit = None if leader is None else leader.outcome.profit
    return {
        "scenario": scenario.name, "soc_reset": scenario.soc_reset, "observation": options.observation,
        "preset": " ".join([options.preset, *options.changes]), "steps": run.training.step, "wall_s": wall_s,
        "cpu_s": cpu_s, "curve": progress.curve, "leader_profit": profit, "highest": seeds[run.highest],
        "seeds": {seed: row(seed, progress.reached, e, profit) for seed, e in zip(seeds, ended, strict=True)},
    }  # fmt: skip


class Stopwatch:
    """Wall and CPU time of the training alone."""

    def __init__(self) -> None:
        self._since = self._now()

    @staticmethod
    def _now() -> tuple[float, float]:
        return time.perf_counter(), time.process_time()

    def read(self) -> tuple[float, float]:
        """Wall and CPU time so far. [s]"""
        now = self._now()
        return now[0] - self._since[0], now[1] - self._since[1]

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Do not count what happens meanwhile."""
        wall_s, cpu_s = self.read()
        yield
        now = self._now()
        self._since = now[0] - wall_s, now[1] - cpu_s


class Progress:
    """How the policies kept so far do on held-out days, evaluation after evaluation."""

    def __init__(self, run: Run, seeds: tuple[int, ...], evaluator: Evaluator, stopwatch: Stopwatch) -> None:
        self.run, self.seeds, self.evaluator, self.stopwatch = run, seeds, evaluator, stopwatch
        self.reached: dict[int, float] = {}
        """CPU time after which a seed stayed at the paper's figures [s]"""
        self.curve: list[dict[str, float]] = []
        self._changes: dict[int, tuple[str, Changes]] = {}

    def evaluate(self, report: Report) -> None:
        """Evaluate the policies that are new since the last time."""
        _, cpu_s = self.stopwatch.read()
        with self.stopwatch.paused():
            for place, seed in enumerate(self.seeds):
                trained = best(self.run, place)
                version = trained.grid.version + trained.prosumers.version
                if place not in self._changes or self._changes[place][0] != version:
                    changes = self.evaluator.evaluate_trained(trained, gaps=False).changes
                    self._changes[place] = (version, changes)
                if reaches(self._changes[place][1]):
                    self.reached.setdefault(seed, cpu_s)
                else:
                    self.reached.pop(seed, None)  # only figures that stay reached count
            self.curve.append({"step": report.step, "cpu_s": cpu_s, "reached": len(self.reached)})


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


def show(results: dict[str, Any]) -> None:
    """A line for each seed, and one for the worst."""
    rows = results["seeds"]
    print(
        f"{results['scenario']}, soc_reset {results['soc_reset']}, observation {results['observation']}, preset "
        f"{results['preset']}: {len(rows)} seeds side by side, {results['steps']:,} vector steps, "
        f"{results['cpu_s']:.0f} CPU-s ({results['wall_s']:.0f} s on the wall)"
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
    print(f"highest rank on the days by which policies are chosen: seed {results['highest']}")


if __name__ == "__main__":
    main()
