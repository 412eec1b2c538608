"""Command-line options of what may learn in the live market: an agent, or a market whose agents all do."""

from __future__ import annotations

import argparse
from pathlib import Path

EXPLORE_SLOTS = 12_000
"""Over which exploration and step size fall to their ends, unless told otherwise."""


def add_learning_options(parser: argparse.ArgumentParser, learned: str) -> None:
    """Add ``--learn`` and what belongs to it.

    Parameters
    ----------
    parser:
        Of the command.
    learned:
        The folder that ``--learned`` stands for when it is not given, as the help tells it.
    """
    learning = parser.add_argument_group("learning (needs the extra learn)")
    learning.add_argument(
        "--learn", action="store_true", help="learn from what comes of the actions; --policy is what it starts from"
    )
    learning.add_argument(
        "--learned",
        type=Path,
        metavar="DIR",
        help=f"where what was learned is kept; from there it goes on when started again (default: {learned})",
    )
    learning.add_argument(
        "--explore",
        type=_slots,
        metavar="SLOTS",
        default=EXPLORE_SLOTS,
        help="slots over which trying out new things fades (default: %(default)s)",
    )
    learning.add_argument(
        "--learn-seed", type=int, metavar="N", default=0, help="seed of what is tried (default: %(default)s)"
    )


def _slots(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give a number of slots from 1 up")
    return int(text)
