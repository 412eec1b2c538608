"""``zengrid top``: watches a running market; ``zengrid up`` shows the same view."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.bus_options import add_bus_options
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.run_command import run_command


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid top",
        description="Watch a running market. Ctrl-C ends the view, and nothing else.",
        examples=["zengrid top", "zengrid top --connect tcp/192.0.2.10:7447 --plain", "zengrid top --json"],
    )
    add_bus_options(it)
    show = it.add_argument_group("view").add_mutually_exclusive_group()
    show.add_argument("--once", action="store_true", help="show the market once")
    show.add_argument("--json", action="store_true", help="print the clock's status once, as JSON")
    show.add_argument("--plain", action="store_true", help="print lines instead of a table, as without a terminal")
    # For zengrid up, which shows what happens to its processes, and where the page is.
    it.add_argument("--events", type=Path, help=argparse.SUPPRESS)
    it.add_argument("--where", default="", help=argparse.SUPPRESS)
    return it


def main(arguments: Sequence[str]) -> int:
    """Show a market."""
    options = parser().parse_args(arguments)
    from zengrid_cli.live_view.watch_market import watch_market

    watch_market(options)
    return 0


if __name__ == "__main__":
    sys.exit(run_command("top", main, sys.argv[1:]))
