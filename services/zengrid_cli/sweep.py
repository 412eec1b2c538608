"""``zengrid sweep``: agents trained for every combination of some values, and one table of all."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zengrid.errors import PolicyError
from zengrid_cli import jobs
from zengrid_cli.options import parse_count
from zengrid_cli.train import learning, pairs

if TYPE_CHECKING:
    import pandas as pd

    from zengrid.learn.sweep.sweep import Sweep

WIDTH = 104
"""Characters that the table needs."""
MOST_SHOWN = 24
"""Cells in the table on the terminal."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid sweep",
        description="Train agents for every combination of values, with several seeds each, and judge them on held-out "
        "days. What is finished is kept: the same command goes on where it was stopped, and one with more values or "
        "seeds trains what is new.",
    )
    it.add_argument(
        "scenario", nargs="?", default="paper", help="built-in scenario or YAML file (default: %(default)s)"
    )
    it.add_argument("--data", type=Path, metavar="DIR", help="folder with the scenario's measured data")
    it.add_argument(
        "--vary", action="append", default=[], metavar="PATH=V1,V2,...", required=True,
        help="values of a scenario's field or a learning setting, such as homes.*.battery.capacity_kwh=6,12 or "
        "grid_lr=1e-3,3e-4 or observation=public,paper; may be given again, and all combinations are trained",
    )  # fmt: skip
    it.add_argument("--seeds", type=parse_count, default=1, metavar="N", help="seeds of each (default: %(default)s)")
    it.add_argument("--first-seed", type=int, default=0, metavar="N", help="the first of them (default: %(default)s)")
    it.add_argument(
        "--set", action="append", default=[], metavar="PATH=VALUE", dest="changes",
        help="one field or setting that is the same for all, such as steps=9000 or soc_reset=never",
    )  # fmt: skip
    it.add_argument(
        "--preset", default="fast",
        help="fast; thorough: five times as long, near an equilibrium; paper: as the authors print it "
        "(default: %(default)s)",
    )  # fmt: skip
    it.add_argument("--observation", choices=["public", "paper"], default="public", help="what agents see")
    it.add_argument("--days", type=parse_count, default=64, metavar="N", help="held-out days (default: %(default)s)")
    it.add_argument("--leader", action="store_true", help="also search for the leader reference of every scenario")
    it.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: runs/sweep-SCENARIO)")
    jobs.add_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Sweep; returns the exit code."""
    options = parser().parse_args(arguments)
    learning()
    from zengrid.learn.sweep.sweep import alone

    axes = dict(axis(text) for text in options.vary)
    folder = options.out or Path("runs") / f"sweep-{Path(options.scenario).stem}"
    command = shlex.join(["zengrid", "sweep", *arguments])
    sweep = plan(options, axes, folder, command)
    with alone(folder):
        left = sweep.jobs()
        if not options.quiet:
            print(told(sweep, axes, len(left)), flush=True)
        if not jobs.do(left, folder / "jobs", options):
            print(f"Stopped; what is finished is kept. To go on: {command}")
            return jobs.STOPPED
        table = finish(sweep, list(axes), command)
    if not options.quiet:
        show(table, list(axes))
        print(f"Written: {folder}/table.csv, table.parquet, figures/sweep.png and .svg")
    return 0


def axis(text: str) -> tuple[str, list[Any]]:
    """``lr=1e-3,1e-4`` -> ``("lr", [0.001, 0.0001])``; commas within brackets part no values."""
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
    return path, [pairs([f"{path}={value}"])[path] for value in values]


def plan(options: argparse.Namespace, axes: Mapping[str, Sequence[Any]], folder: Path, command: str) -> Sweep:
    """What is to be trained, checked before anything is."""
    from zengrid.learn.sweep.axes import cells
    from zengrid.learn.sweep.sweep import Sweep
    from zengrid.scenario import load

    if len(axes) < len(options.vary):
        raise PolicyError(f"--vary: a path stands there twice; permitted: each of {', '.join(axes)} once")
    scenario = load(options.scenario, data=options.data)
    made = cells(scenario, axes, pairs(options.changes), options.preset, options.observation)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    return Sweep(folder, made, seeds, options.days, leader=options.leader, command=command)


def told(sweep: Sweep, axes: Mapping[str, Sequence[Any]], left: int) -> str:
    """What is about to happen."""
    shape = " x ".join(f"{len(values)} {path.rpartition('.')[2]}" for path, values in axes.items())
    finished = len(sweep.done())
    known = f", {finished} of them finished before" if finished else ""
    return f"{shape} x {len(sweep.markets) // len(sweep.cells)} seeds: {len(sweep.markets)} markets{known}; {left} jobs"


def finish(sweep: Sweep, axes: Sequence[str], command: str) -> pd.DataFrame:
    """Write the table, the figure, and what they are of."""
    from zengrid import __version__
    from zengrid.learn.figures.sweep import draw
    from zengrid.learn.sweep.table import save

    table = sweep.table()
    save(table, sweep.folder / "table")
    draw(table, axes, sweep.folder / "figures" / "sweep")
    facts = {
        "command": command, "version": __version__, "axes": list(axes), "cpu_s": round(sweep.cpu_s, 1),
        "seeds": sorted({market.seed for market in sweep.markets}),
        "policies": [
            {**done.market.cell.values, "seed": done.market.seed, "folder": str(done.folder.relative_to(sweep.folder)),
             **done.policies}
            for done in sweep.done()
        ],
    }  # fmt: skip
    (sweep.folder / "sweep.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
    return table


def show(table: pd.DataFrame, axes: Sequence[str]) -> None:
    """Changes against conventional: the median over seeds, and their spread."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    shown = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Change against conventional: median over seeds (spread)")
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
