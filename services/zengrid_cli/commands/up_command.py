"""``zengrid up``: runs a whole market on this machine."""

from __future__ import annotations

import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from zengrid import logs
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.learning_options import add_learning_options
from zengrid.command_line.log_options import add_log_options
from zengrid.command_line.market_options import add_run_market_options, add_server_options
from zengrid.command_line.value_parsers import WholeNumber
from zengrid.errors import EXIT_INTERRUPTED

HTTP_PORT = 8080
SHOW_CURSOR = "\x1b[?25h"


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid up",
        description="Run a whole market on this machine: the clock, the grid agent, and a process for each prosumer.",
        examples=[
            "zengrid up",
            "zengrid up village --days 7 --speed 3600x",
            "zengrid up --listen auto --no-http --quiet --days 1",
        ],
    )
    add_run_market_options(it)
    agents = it.add_argument_group("agents")
    agents.add_argument(
        "--policy",
        metavar="POLICY",
        help="policy of all prosumers: the name of a rule, trained, generic, or a file (default: trained; with --learn "
        "conventional)",
    )
    agents.add_argument(
        "--grid-policy", metavar="POLICY", help="policy of the grid agent (default: trained; with --learn fixed)"
    )
    add_learning_options(it, learned="LOGS/RUN/learned")
    network = it.add_argument_group("network")
    add_server_options(network)
    http = network.add_mutually_exclusive_group()
    http.add_argument(
        "--http",
        type=WholeNumber(1, 65535),
        metavar="PORT",
        help=f"port of the web page (default: {HTTP_PORT}, or a free one)",
    )
    http.add_argument("--no-http", action="store_true", help="run no web page")
    output = it.add_argument_group("output")
    show = output.add_mutually_exclusive_group()
    show.add_argument("--plain", action="store_true", help="print lines instead of a live table, as without a terminal")
    show.add_argument("--quiet", action="store_true", help="print only the summary at the end")
    output.add_argument(
        "--logs", type=Path, default=Path("runs"), metavar="FOLDER", help="folder of the processes' log files"
    )
    add_log_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Run a market until it is over, and print its summary."""
    started = time.time() - _process_age_s()
    options = parser().parse_args(arguments)
    logs.export_settings(options)
    logs.configure("up", options, run=options.run)
    from zengrid_cli.local_market.local_market import LocalMarket

    market = LocalMarket(options, HTTP_PORT)
    code = market.run()
    if market.live:
        # A table that was killed leaves the cursor hidden.
        sys.stdout.write(SHOW_CURSOR)
    if code != EXIT_INTERRUPTED:
        from zengrid_cli.report.run_summary import print_summary

        command = shlex.join(["zengrid", "up", *arguments])
        print_summary(options.journal, options.run, command, since=started)
    if market.failure is not None:
        logs.print_message(market.failure, "error")
        logs.print_message(f"logs: {market.plan.folder}")
    return code


def _process_age_s() -> float:
    """Time since the start of this process, which includes the start of Python. [s]"""
    ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
