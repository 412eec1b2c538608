"""Options that several commands about training share."""

from __future__ import annotations

import argparse
import os

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.value_parsers import WholeNumber

FIRST_SEED_LOW = 0


def add_seed_options(parser: argparse._ActionsContainer, seeds: int | None, default: str = "") -> None:
    """Add ``--seeds`` and ``--first-seed``; ``default`` is what the help says if ``seeds`` is None."""
    remark = f" (default: {default})" if default else ""
    parser.add_argument(
        "--seeds", type=WholeNumber(1), default=seeds, metavar="N", help=f"number of seeds of each market{remark}"
    )
    parser.add_argument(
        "--first-seed", type=WholeNumber(FIRST_SEED_LOW), default=0, metavar="N", help="number of the first seed"
    )


def add_setting_options(parser: argparse._ActionsContainer, metavar: str, help: str) -> None:
    """Add ``--preset``, ``--set`` and ``--observation``."""
    parser.add_argument(
        "--preset",
        choices=["fast", "thorough", "paper"],
        default="fast",
        help="learning settings: fast; thorough: five times as long, near an equilibrium; paper: as the authors "
        "print them",
    )
    parser.add_argument("--set", action="append", metavar=metavar, dest="changes", help=help)
    parser.add_argument(
        "--observation",
        choices=["public", "paper"],
        default="public",
        help="what agents observe: public: with the prices that everybody knows; paper: as in the paper",
    )


def add_job_options(parser: CommandParser) -> None:
    """Add ``--jobs``, ``--cluster`` and ``--quiet``."""
    where = parser.add_argument_group("processes").add_mutually_exclusive_group()
    where.add_argument(
        "--jobs",
        type=WholeNumber(1),
        default=os.cpu_count() or 1,
        metavar="N",
        help="number of processes on this machine (default: one for each processor)",
    )
    where.add_argument(
        "--cluster", metavar="ADDRESS", help="train on a Ray cluster: auto, HOST:6379 or ray://HOST:10001"
    )
    parser.add_argument("--quiet", action="store_true", help="show no progress")
