"""Runs a reproduction of the paper from the command line, and prints its results."""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from zengrid.command_line.assignments import parse_assignments
from zengrid.errors import EXIT_INTERRUPTED
from zengrid.learn.reproduce.study import CAPACITIES_KWH, Study
from zengrid.learn.settings import Settings
from zengrid.learn.sweep.sweep import alone
from zengrid_cli.training.job_runner import run_jobs

TIME = "time.json"
WIDTH = 100
"""Number of characters that the table needs."""
QUICK: dict[str, Any] = {"seeds": 2, "days": 16, "capacities": (2.0, 8.0, 15.0, 25.0), "changes": ["steps=720"]}
"""Options of ``--quick`` instead of the defaults: enough to see all parts work, too little for a result."""


def run_reproduction(options: argparse.Namespace, command: str) -> int:
    """Train what is not trained yet, then write the report and print its table; return the exit code.

    Parameters
    ----------
    options:
        The arguments of ``zengrid reproduce``.
    command:
        The same as it was typed.
    """
    study, started = plan_study(options, command), time.monotonic()
    with alone(study.folder):
        left = study.jobs()
        if not options.quiet:
            markets = len(study.paper.markets) + len(study.capacity.markets)
            print(f"{markets} markets to train and compare in {study.folder}; {len(left)} jobs left", flush=True)
        finished = run_jobs(left, study.folder / "jobs", options)
        wall_s = add_time(study.folder, time.monotonic() - started)
        if not finished:
            print(f"Stopped; finished trainings are kept. To continue: {command}")
            return EXIT_INTERRUPTED
        from zengrid.learn.reproduce.report import REPORT, write  # loads what draws figures

        results = write(study, wall_s)
    if not options.quiet:
        print_results(results)
    print(f"Report: {study.folder / REPORT}")
    return 0


def plan_study(options: argparse.Namespace, command: str) -> Study:
    """What the command line asks to train; all of it is checked before anything is trained."""
    defaults = {"seeds": 5, "days": 64, "capacities": CAPACITIES_KWH, "changes": []}
    defaults |= QUICK if options.quick else {}
    for name, value in defaults.items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    settings = Settings.preset(options.preset).with_(**parse_assignments(options.changes))
    return Study(options.out, seeds, options.capacities, settings, options.observation, options.days, command)


def add_time(folder: Path, wall_s: float) -> float:
    """Add to the time spent on this folder, and return the sum. [s]"""
    path = folder / TIME
    before = json.loads(path.read_text(encoding="utf-8"))["wall_s"] if path.exists() else 0.0
    path.write_text(json.dumps({"wall_s": before + wall_s}), encoding="utf-8")
    return float(before + wall_s)


def print_results(results: dict[str, Any]) -> None:
    """Print the paper's figures, ours and the bound."""
    seeds = len(results["seeds"])
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Change against the baseline, held-out days")
    for heading in ("", "the paper", "ours", "spread", "reached by", "leader", "gap"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for entry in results["figures"]:
        change, gap = entry["change_percent"], entry.get("gap_percent", {"median": None})["median"]
        table.add_row(
            f"{entry['figure']} {entry['agent']}", f"{entry['paper_percent']:+.0f} %", f"{change['median']:+.1f} %",
            f"{change['min']:+.1f} … {change['max']:+.1f} %", f"{entry['reached_by']} of {seeds}",
            f"{entry['leader_percent']:+.1f} %", "" if gap is None else f"{gap:.1f} %",
        )  # fmt: skip
    flat = results["flat_from_kwh"]
    table.caption = (
        f"All five reached by {results['seeds_reaching_all']} of {seeds}. Flat from: bills "
        f"{flat['bill']['agents']['median']:g} kWh, profit {flat['profit']['agents']['median']:g} kWh "
        f"(leader: {flat['bill']['leader']:g}, {flat['profit']['leader']:g}; the paper: about 15). "
        f"{results['time']['wall_s']:.0f} s, {results['time']['cpu_s']:.0f} s of processor time."
    )
    console = Console(highlight=False)
    console.width = max(console.width, WIDTH)  # in a pipe there is no terminal to fit into
    console.print(table)
