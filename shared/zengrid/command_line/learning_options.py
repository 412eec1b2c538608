"""Options of agents that learn in the live market."""

from __future__ import annotations

import argparse
from pathlib import Path

from zengrid.command_line.value_parsers import WholeNumber, parse_integer
from zengrid.learn.live_defaults import EXPLORE_SLOTS


def add_learning_options(parser: argparse.ArgumentParser, learned: str) -> None:
    """Add ``--learn`` and the options that belong to it.

    Parameters
    ----------
    parser:
        Parser of the command.
    learned:
        Default folder of ``--learned``, as the help shows it.
    """
    learning = parser.add_argument_group("learning (needs the extra learn)")
    learning.add_argument("--learn", action="store_true", help="learn while acting; --policy is where it starts from")
    learning.add_argument(
        "--learned",
        type=Path,
        metavar="FOLDER",
        help=f"where the learned state is saved, and loaded from at the next start (default: {learned})",
    )
    learning.add_argument(
        "--explore",
        type=WholeNumber(1),
        metavar="SLOTS",
        default=EXPLORE_SLOTS,
        help="number of slots over which exploration falls to its final rate",
    )
    learning.add_argument(
        "--learn-seed", type=parse_integer, metavar="N", default=0, help="seed of exploration and of new networks"
    )
