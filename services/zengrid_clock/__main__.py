"""``python -m zengrid_clock``: run the clock of one market."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from zengrid import logs
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.log_options import add_log_options
from zengrid.command_line.market_options import add_run_market_options, add_server_options
from zengrid.command_line.run_command import run_command
from zengrid.command_line.value_parsers import Number, WholeNumber

if TYPE_CHECKING:
    from zengrid_clock.clock import Clock


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid clock",
        description="Run the clock of a market: it owns time, settlement and the journal.",
        examples=[
            "zengrid clock --days 7",
            "zengrid clock village --speed 60x --listen tcp/0.0.0.0:7447 --certs certs",
        ],
    )
    add_run_market_options(it)
    agents = it.add_argument_group("agents")
    agents.add_argument(
        "--wait",
        type=Number(unit="s"),
        default=15.0,
        metavar="SECONDS",
        help="longest wait for the agents before the first slot",
    )
    agents.add_argument(
        "--max-homes", type=WholeNumber(1), default=100_000, metavar="N", help="largest number of homes in the market"
    )
    add_server_options(it.add_argument_group("network"))
    add_log_options(it)
    return it


def open_clock(options: argparse.Namespace, stack: ExitStack) -> Clock:
    """Put a clock together; what it holds open is closed with the stack."""
    from zengrid import __version__
    from zengrid.bus.clock_link import ClockLink
    from zengrid.journal import Journal
    from zengrid.scenario import Days, dumps, load
    from zengrid_clock.clock import Clock, ClockSettings
    from zengrid_clock.retention import Retention

    settings = ClockSettings(
        days=options.days,
        speed=options.speed,
        deadline_s=options.deadline,
        wait_s=options.wait,
        paused=options.paused,
        max_homes=options.max_homes,
        journal_wait_s=options.journal_wait,
    )
    # The hub first: agents that start at the same time can connect while the rest is made ready.
    hub = stack.enter_context(ClockLink(options.run, options.listen, certs=options.certs, insecure=options.insecure))
    scenario = load(options.scenario, data=options.data, seed=options.seed).with_(soc_reset=options.soc_reset)
    days = Days(scenario)
    journal = stack.enter_context(Journal.open(options.journal, durability=options.durability))

    def keeping(clock: Clock) -> Clock:
        if options.keep_days is not None:
            clock.retention = stack.enter_context(
                Retention(journal, clock.run.name, options.keep_days, logs.print_message)
            )
        return clock

    earlier = [info for info in journal.runs() if info.name.rpartition("-")[0] == options.run]
    if options.resume and earlier and earlier[-1].finished_at is None:
        clock = Clock(scenario, days, hub, journal.resume(earlier[-1].id), settings)
        clock.resume()
        return keeping(clock)
    name = f"{options.run}-{len(earlier) + 1}"
    run = journal.begin(name, dumps(scenario), seed=scenario.seed, dt_h=scenario.dt_h, version=__version__)
    clock = Clock(scenario, days, hub, run, settings)
    clock.event_log.log("info", "run begins", journal=name, scenario=scenario.name, seed=scenario.seed)
    return keeping(clock)


def main(arguments: Sequence[str]) -> int:
    """Run the clock until its market ends."""
    options = parser().parse_args(arguments)
    logs.configure("clock", options, run=options.run)
    with ExitStack() as stack:
        open_clock(options, stack).serve()
    return 0


if __name__ == "__main__":
    sys.exit(run_command("clock", main, sys.argv[1:]))
