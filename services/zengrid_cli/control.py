"""``zengrid control``: steer a running market."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from zengrid.bus.options import add_bus_options
from zengrid_cli.options import parse_count, parse_speed

TIMEOUT_S = 5.0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(prog="zengrid control", description="Steer a running market.")
    commands = it.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in (
        ("status", "say how it stands"),
        ("pause", "stand still before the next slot"),
        ("resume", "go on"),
        ("step", "run some slots, then stand still"),
        ("speed", "change the speed"),
        ("stop", "end the market"),
    ):
        command = commands.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        if name == "step":
            command.add_argument("slots", nargs="?", type=parse_count, default=1, help="how many (default: 1)")
        if name == "speed":
            command.add_argument("speed", type=parse_speed, help="max, or times real time such as 60x or 1x")
        add_bus_options(command)
    return it


def main(arguments: Sequence[str]) -> int:
    """Ask the clock, and say how the market stands then."""
    options = parser().parse_args(arguments)
    from zengrid.bus.market_client import MarketClient
    from zengrid_cli.figures import pace, progress

    with MarketClient(options.run, options.connect, certs=options.certs, timeout_s=TIMEOUT_S) as client:
        status = client.control(
            options.command, slots=getattr(options, "slots", 1), speed=getattr(options, "speed", None), homes=False
        )
    print(f"{status.scenario} ({status.run}): {status.state}, {pace(status)}, {progress(status)}")
    return 0
