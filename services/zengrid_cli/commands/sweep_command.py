"""``zengrid sweep``: trains agents for every combination of some values, and writes one table of all."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_scenario_options
from zengrid.command_line.value_parsers import WholeNumber
from zengrid_cli.training.training_options import add_job_options, add_seed_options, add_setting_options


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid sweep",
        description="Train agents for every combination of values, with several seeds each, and evaluate them on "
        "held-out days. Finished trainings are kept: the same command continues where it was stopped, and one with "
        "more values or seeds trains only what is new.",
        examples=[
            "zengrid sweep --vary homes.*.battery.capacity_kwh=6,12 --seeds 3",
            "zengrid sweep --vary observation=public,paper --set steps=240 --days 4",
        ],
    )
    what = it.add_argument_group("training")
    add_scenario_options(what)
    what.add_argument(
        "--vary", action="append", default=[], metavar="PATH=V1,V2,...", required=True,
        help="values of a field of the scenario or a learning setting, such as homes.*.battery.capacity_kwh=6,12 or "
        "grid_lr=1e-3,3e-4 or observation=public,paper; may be repeated, and all combinations are trained",
    )  # fmt: skip
    add_seed_options(what, seeds=1)
    add_setting_options(
        what,
        "PATH=VALUE",
        "a field or setting that is the same for all, such as steps=9000 or soc_reset=never; may be repeated",
    )
    result = it.add_argument_group("evaluation")
    result.add_argument("--days", type=WholeNumber(1), default=64, metavar="N", help="number of held-out days")
    result.add_argument("--leader", action="store_true", help="also search for the leader reference of every scenario")
    result.add_argument("--out", type=Path, metavar="FOLDER", help="where to write (default: runs/sweep-SCENARIO)")
    add_job_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Sweep; return the exit code."""
    options = parser().parse_args(arguments)
    from zengrid.learn.require_torch import require_torch

    require_torch()
    from zengrid_cli.training.run_sweep import run_sweep

    return run_sweep(options, shlex.join(["zengrid", "sweep", *arguments]))
