"""``zengrid certs``: makes an authority, and certificates for the clock, the operators and the agents."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from zengrid.bus.credentials import RESERVED_NAMES, SPAWNER
from zengrid.bus.keys import DEFAULT_RUN
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_data_option
from zengrid.command_line.value_parsers import WholeNumber

MAX_DAYS = 3650
_ID = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")


def parse_ids(text: str) -> list[str]:
    """Parse names with commas between them."""
    ids = text.split(",")
    for name in ids:
        if not _ID.fullmatch(name):
            raise argparse.ArgumentTypeError(
                f"id = {name}: permitted: 1 to 63 of a-z, 0-9, _ and -, beginning with a letter or digit"
            )
        if name in RESERVED_NAMES:
            raise argparse.ArgumentTypeError(
                f"id = {name}: is the name of a role; not permitted: {', '.join(RESERVED_NAMES)}"
            )
    return ids


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid certs",
        description="Make certificates: an authority, the clock, gateway, spawner and operator, and agents. "
        "Run it again to add names or to renew certificates; existing keys are never replaced.",
        examples=[
            "zengrid certs certs --scenario paper --host 192.0.2.10",
            "zengrid certs certs --ids p7,heat-pump --days 90",
            "zengrid certs certs --revoke p7",
        ],
    )
    it.add_argument("folder", type=Path, help="where the certificates are; made if it does not exist")
    _add_agent_options(it)
    _add_other_options(it)
    return it


def _add_agent_options(it: CommandParser) -> None:
    agents = it.add_argument_group("agents")
    agents.add_argument(
        "--scenario", metavar="SCENARIO", help="make certificates for the agents of a scenario, built-in or YAML file"
    )
    add_data_option(agents)
    agents.add_argument(
        "--ids", type=parse_ids, default=[], metavar="ID,...", help="make certificates for agents of these names"
    )
    agents.add_argument(
        "--spare",
        type=WholeNumber(0),
        default=0,
        metavar="N",
        help="make N more, called p1, p2, ..., for homes that join later",
    )
    agents.add_argument(
        "--revoke",
        type=parse_ids,
        default=[],
        metavar="ID,...",
        help="remove these names from the access list permanently",
    )


def _add_other_options(it: CommandParser) -> None:
    others = it.add_argument_group("services")
    others.add_argument(
        "--host",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="name or address under which others reach the clock or a router; may be repeated",
    )
    others.add_argument(
        "--spawner", type=parse_ids, default=[SPAWNER], metavar="NAME,...", help="names of spawners (default: spawner)"
    )
    others.add_argument(
        "--days", type=WholeNumber(1, MAX_DAYS), default=365, metavar="N", help="number of days of validity"
    )
    others.add_argument(
        "--router",
        metavar="ENDPOINT",
        help="also write router.json5, the configuration of a Zenoh router in front of the clock that listens there",
    )
    others.add_argument("--run", default=DEFAULT_RUN, metavar="NAME", help="name of the market for the router")
    others.add_argument(
        "--renew", action="store_true", help="make new certificates for all names, with the keys they have"
    )


def main(arguments: Sequence[str]) -> int:
    """Make what is missing, and print one line for each change."""
    options = parser().parse_args(arguments)
    from zengrid_cli.certificate_folder import update_folder

    for line in update_folder(options):
        print(line)
    return 0
