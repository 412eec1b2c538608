"""``zengrid reproduce``: every figure and number of the paper from nothing, in one report."""

from __future__ import annotations

import argparse
import json
import shlex
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zengrid.errors import PolicyError
from zengrid_cli import jobs
from zengrid_cli.options import parse_count
from zengrid_cli.train import learning, pairs

if TYPE_CHECKING:
    from zengrid.learn.reproduce.study import Study

TIME = "time.json"
WIDTH = 100
"""Characters that the table needs."""
QUICK: dict[str, Any] = {"seeds": 2, "days": 16, "capacities": (2.0, 8.0, 15.0, 25.0), "changes": ["steps=720"]}
"""Instead of the defaults: enough to see everything work, too little to judge it by."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid reproduce",
        description="Train the paper's case study and its batteries of other sizes, and write a report with every "
        "figure and number of the paper beside ours and the bound. The same command goes on where it was stopped.",
    )
    it.add_argument(
        "--out", type=Path, default=Path("runs/reproduce"), metavar="DIR", help="where to write (default: %(default)s)"
    )
    it.add_argument("--seeds", type=parse_count, metavar="N", help="seeds of everything (default: 5)")
    it.add_argument("--first-seed", type=int, default=0, metavar="N", help="the first of them (default: %(default)s)")
    it.add_argument(
        "--quick", action="store_true", help="2 seeds, a quarter of the training, 4 battery sizes: a look, no result"
    )
    it.add_argument(
        "--capacities", type=parse_sizes, metavar="KWH,...",
        help="battery sizes (default: 2,4,6,8,10,12,15,20,25)",
    )  # fmt: skip
    it.add_argument("--days", type=parse_count, metavar="N", help="held-out days (default: 64)")
    it.add_argument(
        "--preset", default="fast",
        help="fast; thorough: five times as long, near an equilibrium; paper: as the authors print it "
        "(default: %(default)s)",
    )  # fmt: skip
    it.add_argument(
        "--set", action="append", metavar="NAME=VALUE", dest="changes", help="one learning setting, such as steps=9000"
    )
    it.add_argument("--observation", choices=["public", "paper"], default="public", help="what agents see")
    jobs.add_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Reproduce; returns the exit code."""
    options = parser().parse_args(arguments)
    learning()
    from zengrid.learn.sweep.sweep import alone

    command = shlex.join(["zengrid", "reproduce", *arguments])
    study, begun = plan(options, command), time.monotonic()
    with alone(study.folder):
        left = study.jobs()
        if not options.quiet:
            markets = len(study.paper.markets) + len(study.capacity.markets)
            print(f"{markets} markets to train and compare in {study.folder}; {len(left)} jobs left", flush=True)
        finished = jobs.do(left, study.folder / "jobs", options)
        wall_s = spent(study.folder, time.monotonic() - begun)
        if not finished:
            print(f"Stopped; what is finished is kept. To go on: {command}")
            return jobs.STOPPED
        from zengrid.learn.reproduce.report import REPORT, write

        results = write(study, wall_s)
    if not options.quiet:
        show(results)
    print(f"Report: {study.folder / REPORT}")
    return 0


def parse_sizes(text: str) -> tuple[float, ...]:
    """``2,4,6`` -> (2.0, 4.0, 6.0)."""
    try:
        return tuple(float(size) for size in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: give sizes in kWh such as 2,6,12") from None


def plan(options: argparse.Namespace, command: str) -> Study:
    """What is to be trained, checked before anything is."""
    from zengrid.learn.reproduce.study import CAPACITIES_KWH, Study
    from zengrid.learn.settings import Settings

    defaults = {"seeds": 5, "days": 64, "capacities": CAPACITIES_KWH, "changes": []}
    defaults |= QUICK if options.quick else {}
    for name, value in defaults.items():
        if getattr(options, name) is None:
            setattr(options, name, value)
    if options.first_seed < 0:
        raise PolicyError(f"--first-seed = {options.first_seed}: permitted: 0 or more")
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    settings = Settings.preset(options.preset).with_(**pairs(options.changes))
    return Study(options.out, seeds, options.capacities, settings, options.observation, options.days, command)


def spent(folder: Path, wall_s: float) -> float:
    """Time spent in this folder so far, earlier sessions included. [s]"""
    path = folder / TIME
    before = json.loads(path.read_text(encoding="utf-8"))["wall_s"] if path.exists() else 0.0
    path.write_text(json.dumps({"wall_s": before + wall_s}), encoding="utf-8")
    return float(before + wall_s)


def show(results: dict[str, Any]) -> None:
    """The paper's figures, ours and the bound."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    seeds = len(results["seeds"])
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Against the conventional market, held-out days")
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
        f"{results['time']['wall_s']:.0f} s, {results['time']['cpu_s']:.0f} s of processors."
    )
    console = Console(highlight=False)
    console.width = max(console.width, WIDTH)  # in a pipe there is no terminal to fit into
    console.print(table)
