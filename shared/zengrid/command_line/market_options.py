"""Options of the processes that run a market: its scenario, its pace, its journal and its network."""

from __future__ import annotations

import argparse
from pathlib import Path

from zengrid.command_line.bus_options import add_certs_option, add_listen_option, add_run_option
from zengrid.command_line.value_parsers import Number, WholeNumber, parse_integer, parse_speed

DEFAULT_JOURNAL = "zengrid.db"
MAX_DEADLINE_S = 3600.0


def add_scenario_options(parser: argparse._ActionsContainer) -> None:
    """Add the scenario and ``--data``."""
    parser.add_argument("scenario", nargs="?", default="paper", help="built-in scenario or YAML file")
    add_data_option(parser)


def add_data_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--data``."""
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="folder of the scenario's measured data")


def add_run_market_options(parser: argparse.ArgumentParser) -> None:
    """Add all options that ``zengrid up`` and ``zengrid clock`` share, but not the network's."""
    market = parser.add_argument_group("market")
    add_scenario_options(market)
    market.add_argument("--days", type=WholeNumber(1), metavar="N", help="end after N days (default: never)")
    market.add_argument(
        "--seed", type=parse_integer, metavar="N", help="seed of the days' noise (default: the scenario's)"
    )
    market.add_argument(
        "--speed",
        type=parse_speed,
        default=0.0,
        metavar="SPEED",
        help="max, or a factor on real time such as 60x or 1x (default: max)",
    )
    market.add_argument(
        "--deadline",
        type=Number(above=True, high=MAX_DEADLINE_S, unit="s"),
        default=2.0,
        metavar="SECONDS",
        help="longest wait for the agents' actions in each phase of a slot",
    )
    market.add_argument(
        "--soc-reset",
        choices=["daily", "never"],
        default="never",
        help="daily: batteries start each day with their initial state of charge, as in the paper's episodes",
    )
    market.add_argument("--paused", action="store_true", help="pause before the first slot")
    _add_journal_options(parser)


def _add_journal_options(parser: argparse.ArgumentParser) -> None:
    journal = parser.add_argument_group("journal")
    add_journal_option(journal)
    journal.add_argument(
        "--keep-days",
        type=WholeNumber(1),
        metavar="N",
        help="delete all but the last N days from the journal (default: keep all)",
    )
    journal.add_argument(
        "--journal-wait",
        type=Number(unit="s"),
        default=3600.0,
        metavar="SECONDS",
        help="longest wait for a journal that cannot be written, before the clock ends",
    )
    journal.add_argument(
        "--resume", action="store_true", help="continue the last run of this name in the journal, if it has not ended"
    )
    journal.add_argument(
        "--durability",
        choices=["normal", "full"],
        default="normal",
        help="normal: settled slots survive a crash of the process; full: also a power failure",
    )


def add_journal_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--journal``."""
    parser.add_argument(
        "--journal", default=DEFAULT_JOURNAL, metavar="FILE|URL", help="SQLite file or PostgreSQL URL of settled slots"
    )


def add_server_options(parser: argparse._ActionsContainer) -> None:
    """Add ``--run``, ``--listen``, ``--insecure`` and ``--certs``."""
    add_run_option(parser)
    add_listen_option(parser)
    add_certs_option(parser)
