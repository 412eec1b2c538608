"""Values that several commands take, and the command line of ``zengrid up``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from zengrid import logs
from zengrid.learn.options import add_learning_options

HTTP_PORT = 8080


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


def parse_count(text: str) -> int:
    """A whole number from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text}: give a whole number from 1 up")
    return int(text)


def parse_port(text: str) -> int:
    """A TCP port."""
    if not text.isdecimal() or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f"port = {text}: permitted: 1 to 65535")
    return int(text)


def parse_deadline(text: str) -> float:
    """A time above zero. [s]"""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 < seconds <= 3600:
        raise argparse.ArgumentTypeError(f"deadline = {text}: permitted: above 0, up to 3600 s")
    return seconds


def up_parser() -> argparse.ArgumentParser:
    """The command line of ``zengrid up``."""
    from zengrid.bus.options import add_certs_option  # loads Zenoh, which commands that only train do without

    # The bus knows these defaults, too; loading it would hold up the clock that is to be started first.
    it = argparse.ArgumentParser(
        prog="zengrid up",
        description="Run a whole market on this machine: the clock, the grid agent, and a process for each prosumer.",
    )
    market = it.add_argument_group("the market")
    market.add_argument(
        "scenario", nargs="?", default="paper", help="built-in scenario or YAML file (default: %(default)s)"
    )
    market.add_argument("--data", type=Path, metavar="DIR", help="folder with the scenario's measured data")
    market.add_argument("--days", type=parse_count, metavar="N", help="end after so many days (default: never)")
    market.add_argument("--seed", type=int, metavar="N", help="seed of the days (default: the scenario's)")
    market.add_argument(
        "--speed", type=parse_speed, default=0.0, help="max, or times real time such as 60x or 1x (default: max)"
    )
    market.add_argument(
        "--deadline",
        type=parse_deadline,
        default=2.0,
        metavar="S",
        help="longest wait for a phase's answers (default: %(default)s s)",
    )
    market.add_argument(
        "--soc-reset",
        choices=["daily", "never"],
        default="never",
        help="daily: batteries start each day as the first, as in the paper's episodes (default: %(default)s)",
    )
    market.add_argument("--paused", action="store_true", help="stand still before the first slot")
    market.add_argument(
        "--policy",
        metavar="SPEC",
        help="what decides for all prosumers (default: trained, what comes with zengrid; with --learn conventional)",
    )
    market.add_argument(
        "--grid-policy",
        metavar="SPEC",
        help="what decides for the grid agent (default: trained; with --learn fixed)",
    )
    add_learning_options(it, learned="LOGS/RUN/learned")
    journal = it.add_argument_group("the journal")
    journal.add_argument(
        "--journal",
        default="zengrid.db",
        metavar="FILE|URL",
        help="where settled slots are kept (default: %(default)s)",
    )
    journal.add_argument(
        "--keep-days",
        type=parse_count,
        metavar="N",
        help="delete all but the last N days from the journal (default: keep all)",
    )
    journal.add_argument(
        "--journal-wait",
        type=float,
        metavar="S",
        help="longest wait for a journal that cannot take a slot (default: an hour)",
    )
    journal.add_argument("--resume", action="store_true", help="go on with the last run in the journal")
    journal.add_argument(
        "--durability", choices=["normal", "full"], default="normal", help="full: survive power loss, not only crashes"
    )
    journal.add_argument(
        "--logs", type=Path, default=Path("runs"), metavar="DIR", help="where processes write to (default: %(default)s)"
    )
    net = it.add_argument_group("the network")
    net.add_argument(
        "--run",
        default=os.environ.get("ZENGRID_RUN", "main"),
        metavar="NAME",
        help="name of the market (default: %(default)s; environment: ZENGRID_RUN)",
    )
    net.add_argument(
        "--listen",
        default=os.environ.get("ZENGRID_LISTEN", "tcp/127.0.0.1:7447"),
        metavar="ENDPOINT",
        help="where agents connect, or auto for any free port (default: %(default)s; environment: ZENGRID_LISTEN)",
    )
    add_certs_option(net)
    net.add_argument("--insecure", action="store_true", help="listen beyond this machine, without authentication")
    http = net.add_mutually_exclusive_group()
    http.add_argument(
        "--http", type=parse_port, metavar="PORT", help=f"port of the web page (default: {HTTP_PORT} or a free one)"
    )
    http.add_argument("--no-http", action="store_true", help="no web page")
    show = it.add_argument_group("what is shown").add_mutually_exclusive_group()
    show.add_argument(
        "--plain", action="store_true", help="lines instead of a live table (so where there is no terminal)"
    )
    show.add_argument("--quiet", action="store_true", help="only the summary at the end")
    logs.add_log_options(it.add_argument_group("logs"))
    return it
