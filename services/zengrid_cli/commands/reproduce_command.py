"""``zengrid reproduce``: reproduces every figure and number of the paper, and writes one report."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.value_parsers import WholeNumber
from zengrid_cli.training.training_options import add_job_options, add_seed_options, add_setting_options


def parse_sizes(text: str) -> tuple[float, ...]:
    """``2,4,6`` -> (2.0, 4.0, 6.0)."""
    try:
        sizes = tuple(float(size) for size in text.split(","))
    except ValueError:
        sizes = (math.nan,)
    if not all(0 < size < math.inf for size in sizes):
        raise argparse.ArgumentTypeError("permitted: sizes above 0 kWh with commas between them, such as 2,6,12")
    return sizes


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid reproduce",
        description="Train the paper's case study, and the same with batteries of other sizes. Write a report with "
        "every figure and number of the paper beside ours and the bound. The same command continues where it was "
        "stopped.",
        examples=["zengrid reproduce", "zengrid reproduce --quick", "zengrid reproduce --seeds 3 --capacities 2,8,15"],
    )
    what = it.add_argument_group("training")
    what.add_argument(
        "--quick", action="store_true", help="2 seeds, a quarter of the training, 4 battery sizes: a look, not a result"
    )
    add_seed_options(what, seeds=None, default="5")
    what.add_argument(
        "--capacities", type=parse_sizes, metavar="KWH,...",
        help="battery sizes (default: 2,4,6,8,10,12,15,20,25)",
    )  # fmt: skip
    add_setting_options(what, "NAME=VALUE", "change a learning setting, such as steps=9000; may be repeated")
    result = it.add_argument_group("evaluation")
    result.add_argument("--days", type=WholeNumber(1), metavar="N", help="number of held-out days (default: 64)")
    result.add_argument(
        "--out", type=Path, default=Path("runs/reproduce"), metavar="FOLDER", help="where to write the report"
    )
    add_job_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Reproduce; return the exit code."""
    options = parser().parse_args(arguments)
    from zengrid.learn.require_torch import require_torch

    require_torch()
    from zengrid_cli.training.run_reproduction import run_reproduction

    return run_reproduction(options, shlex.join(["zengrid", "reproduce", *arguments]))
