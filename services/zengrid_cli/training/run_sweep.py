"""Runs a sweep from the command line, and writes and prints its table."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from rich import box
from rich.console import Console
from rich.table import Table

from zengrid import __version__
from zengrid.command_line.assignments import parse_assignments
from zengrid.errors import EXIT_INTERRUPTED, PolicyError
from zengrid.learn.figures.sweep import draw
from zengrid.learn.sweep.axes import cells
from zengrid.learn.sweep.sweep import Sweep, alone
from zengrid.learn.sweep.table import save
from zengrid.scenario import load
from zengrid_cli.training.job_runner import run_jobs

WIDTH = 104
"""Number of characters that the table needs."""
MOST_SHOWN = 24
"""Largest number of cells in the table on the terminal."""


def run_sweep(options: argparse.Namespace, command: str) -> int:
    """Train what is not trained yet, then write and print the table; return the exit code.

    Parameters
    ----------
    options:
        The arguments of ``zengrid sweep``.
    command:
        The same as it was typed.
    """
    axes = dict(parse_axis(text) for text in options.vary)
    folder = options.out or Path("runs") / f"sweep-{Path(options.scenario).stem}"
    sweep = plan_sweep(options, axes, folder, command)
    with alone(folder):
        left = sweep.jobs()
        if not options.quiet:
            print(describe_sweep(sweep, axes, len(left)), flush=True)
        if not run_jobs(left, folder / "jobs", options):
            print(f"Stopped; finished trainings are kept. To continue: {command}")
            return EXIT_INTERRUPTED
        table = write_results(sweep, list(axes), command)
    if not options.quiet:
        print_table(table, list(axes))
        print(f"Written: {folder}/table.csv, table.parquet, figures/sweep.png and .svg")
    return 0


def parse_axis(text: str) -> tuple[str, list[Any]]:
    """``lr=1e-3,1e-4`` -> ``("lr", [0.001, 0.0001])``; commas within brackets separate no values."""
    path, equals, rest = text.partition("=")
    if not equals or not path:
        raise PolicyError(f"--vary {text}: give PATH=V1,V2,...")
    values, depth = [""], 0
    for sign in rest:
        depth += (sign in "[{") - (sign in "]}")
        if sign == "," and depth == 0:
            values.append("")
        else:
            values[-1] += sign
    if not all(values):
        raise PolicyError(f"--vary {text}: an empty value; give PATH=V1,V2,...")
    return path, [parse_assignments([f"{path}={value}"])[path] for value in values]


def plan_sweep(options: argparse.Namespace, axes: Mapping[str, Sequence[Any]], folder: Path, command: str) -> Sweep:
    """What the command line asks to train; all of it is checked before anything is trained."""
    if len(axes) < len(options.vary):
        raise PolicyError(f"--vary: a path is given twice; permitted: each of {', '.join(axes)} once")
    scenario = load(options.scenario, data=options.data)
    made = cells(scenario, axes, parse_assignments(options.changes or []), options.preset, options.observation)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    return Sweep(folder, made, seeds, options.days, leader=options.leader, command=command)


def describe_sweep(sweep: Sweep, axes: Mapping[str, Sequence[Any]], left: int) -> str:
    """How much there is to train."""
    shape = " x ".join(f"{len(values)} {path.rpartition('.')[2]}" for path, values in axes.items())
    finished = len(sweep.done())
    known = f", {finished} of them finished before" if finished else ""
    return f"{shape} x {len(sweep.markets) // len(sweep.cells)} seeds: {len(sweep.markets)} markets{known}; {left} jobs"


def write_results(sweep: Sweep, axes: Sequence[str], command: str) -> pd.DataFrame:
    """Write the table, the figure, and ``sweep.json`` with the command and the policies."""
    table = sweep.table()
    save(table, sweep.folder / "table")
    draw(table, axes, sweep.folder / "figures" / "sweep")
    summary = {
        "command": command, "version": __version__, "axes": list(axes), "cpu_s": round(sweep.cpu_s, 1),
        "seeds": sorted({market.seed for market in sweep.markets}),
        "policies": [
            {**done.market.cell.values, "seed": done.market.seed, "folder": str(done.folder.relative_to(sweep.folder)),
             **done.policies}
            for done in sweep.done()
        ],
    }  # fmt: skip
    (sweep.folder / "sweep.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    return table


def print_table(table: pd.DataFrame, axes: Sequence[str]) -> None:
    """Print the changes against the baseline: the median over seeds, and their spread."""
    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Change against the baseline: median over seeds (spread)")
    for name in axes:
        shown.add_column(name.rpartition(".")[2])
    headings = {"bill": "bills, mean of homes", "profit": "grid profit", "reserve_kwh": "reserve energy"}
    for heading in headings.values():
        shown.add_column(heading, justify="right", no_wrap=True)
    figures = table[table.figure.isin(headings)]
    cells = list(figures.groupby(list(axes), sort=False, dropna=False))
    for key, cell in cells[:MOST_SHOWN]:
        seeds = cell.groupby(["seed", "figure"]).change_percent.mean().unstack("figure")
        changes = [seeds[name].dropna() for name in headings]
        shown.add_row(
            *map(str, key),
            *(f"{c.median():+.1f} % ({c.min():+.0f} … {c.max():+.0f})" if len(c) else "–" for c in changes),
        )
    console = Console(highlight=False)
    console.width = max(console.width, WIDTH)  # in a pipe there is no terminal to fit into
    console.print(shown)
    if len(cells) > MOST_SHOWN:
        console.print(f"and {len(cells) - MOST_SHOWN} more in the table")
