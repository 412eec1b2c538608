"""``python -m zengrid_clock``: run the clock of one market."""

from __future__ import annotations

import argparse
import os
import sys
import traceback
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from zengrid import logs
from zengrid.errors import EXIT_INTERNAL, ZengridError

if TYPE_CHECKING:
    from zengrid_clock.clock import Clock


def parser() -> argparse.ArgumentParser:
    """The command line of the clock."""
    from zengrid.bus.keys import DEFAULT_RUN
    from zengrid.bus.options import add_certs_option
    from zengrid.bus.zenoh_session import DEFAULT_ENDPOINT

    it = argparse.ArgumentParser(
        prog="zengrid clock", description="Own the environment of a market: time, settlement, journal."
    )
    it.add_argument(
        "scenario", nargs="?", default="paper", help="built-in scenario or YAML file (default: %(default)s)"
    )
    it.add_argument("--data", type=Path, help="folder with the scenario's measured data")
    it.add_argument("--seed", type=int, help="seed of the days (default: the scenario's)")
    it.add_argument(
        "--soc-reset",
        choices=["daily", "never"],
        default="never",
        help="daily: batteries start each day as the first, as in the paper's episodes (default: %(default)s)",
    )
    it.add_argument("--days", type=int, help="end after so many days (default: never)")
    it.add_argument(
        "--speed",
        type=parse_speed,
        default=0.0,
        metavar="SPEED",
        help="max, or times real time such as 60x (default: max)",
    )
    it.add_argument(
        "--deadline",
        type=float,
        default=2.0,
        metavar="S",
        help="longest wait for a phase's answers (default: %(default)s s)",
    )
    it.add_argument(
        "--wait",
        type=float,
        default=15.0,
        metavar="S",
        help="longest wait for the agents before the first slot (default: %(default)s s)",
    )
    it.add_argument("--paused", action="store_true", help="stand still before the first slot")
    it.add_argument(
        "--max-homes", type=int, default=100_000, help="most homes this market takes (default: %(default)s)"
    )
    it.add_argument(
        "--journal",
        default="zengrid.db",
        metavar="FILE|URL",
        help="where settled slots are kept (default: %(default)s)",
    )
    it.add_argument(
        "--durability", choices=["normal", "full"], default="normal", help="full: survive power loss, not only crashes"
    )
    it.add_argument(
        "--keep-days",
        type=parse_days,
        metavar="N",
        help="delete all but the last N days from the journal (default: keep all)",
    )
    it.add_argument(
        "--journal-wait",
        type=float,
        default=3600.0,
        metavar="S",
        help="longest wait for a journal that cannot take a slot, before the clock ends (default: %(default)s s)",
    )
    it.add_argument(
        "--resume", action="store_true", help="go on with the run of this name in the journal, if it has not ended"
    )
    it.add_argument(
        "--run",
        default=os.environ.get("ZENGRID_RUN", DEFAULT_RUN),
        metavar="NAME",
        help="name of the market (default: %(default)s)",
    )
    it.add_argument(
        "--listen",
        default=os.environ.get("ZENGRID_LISTEN", DEFAULT_ENDPOINT),
        metavar="ENDPOINT",
        help="where agents connect (default: %(default)s)",
    )
    add_certs_option(it)
    it.add_argument(
        "--insecure", action="store_true", help="listen beyond this machine although nobody is authenticated"
    )
    logs.add_log_options(it)
    return it


def parse_speed(text: str) -> float:
    """``max`` -> 0, ``60x`` or ``60`` -> 60."""
    if text == "max":
        return 0.0
    try:
        speed = float(text.removesuffix("x"))
    except ValueError:
        speed = -1.0
    if not 0 < speed <= 1e9:
        raise argparse.ArgumentTypeError(f"speed = {text}: give max, or times real time such as 1x, 60x, 0.5x")
    return speed


def parse_days(text: str) -> int:
    """A whole number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"days = {text}: give a whole number from 1 up")
    return int(text)


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
            clock.retention = stack.enter_context(Retention(journal, clock.run.name, options.keep_days, logs.say))
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


def main(arguments: list[str] | None = None) -> int:
    """Run the clock until its market ends."""
    options = parser().parse_args(arguments)
    logs.begin("clock", options, run=options.run)
    try:
        with ExitStack() as stack:
            open_clock(options, stack).serve()
    except ZengridError as error:
        logs.fail(error)
        return 1
    except Exception as error:  # noqa: BLE001 - tells a fault of the program from one that the user can mend
        logs.fail("".join(traceback.format_exception(error)))
        return EXIT_INTERNAL
    return 0


if __name__ == "__main__":
    sys.exit(main())
