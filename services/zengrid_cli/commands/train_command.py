"""``zengrid train``: trains agents in a simulated market, and writes policy files."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_scenario_options
from zengrid.command_line.value_parsers import Number, WholeNumber
from zengrid_cli.training.training_options import add_seed_options, add_setting_options


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid train",
        description="Train a grid agent and prosumer agents. Several seeds are trained at once, side by side.",
        examples=["zengrid train", "zengrid train village --seeds 3 --preset thorough", "zengrid train --resume"],
    )
    what = it.add_argument_group("training")
    add_scenario_options(what)
    what.add_argument(
        "--scenario-set", action="append", default=[], metavar="PATH=VALUE", dest="scenario_changes",
        help="change a field of the scenario, such as soc_reset=never or homes.*.battery.capacity_kwh=10; may be "
        "repeated",
    )  # fmt: skip
    add_seed_options(what, seeds=1)
    add_setting_options(
        what,
        "NAME=VALUE",
        "change a learning setting, such as steps=9000, lr=1e-3 or grid_epsilon_end=0.05; may be repeated",
    )
    how = it.add_argument_group("execution")
    how.add_argument("--out", type=Path, metavar="FOLDER", help="where to write (default: runs/train-SCENARIO)")
    how.add_argument(
        "--resume", action="store_true", help="continue the training in that folder exactly where it stopped"
    )
    how.add_argument(
        "--time-limit", type=Number(above=True, unit="s"), metavar="SECONDS", help="stop after this time of training"
    )
    how.add_argument("--every", type=WholeNumber(1), default=5, metavar="DAYS", help="days between evaluations")
    how.add_argument("--device", default="cpu", metavar="NAME", help="cpu, or cuda where there is a GPU")
    how.add_argument("--threads", type=WholeNumber(1), default=1, metavar="N", help="number of threads of torch")
    how.add_argument("--quiet", action="store_true", help="print only the last line")
    return it


def main(arguments: Sequence[str]) -> int:
    """Train; return the exit code."""
    options = parser().parse_args(arguments)
    from zengrid.learn.require_torch import require_torch

    require_torch()
    from zengrid_cli.training.follow_training import train

    return train(options, shlex.join(["zengrid", "train", *arguments]))
