"""``zengrid control``: pause, resume, step, speed up or stop a running market."""

from __future__ import annotations

from collections.abc import Sequence

from zengrid.command_line.bus_options import add_bus_options
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.value_parsers import WholeNumber, parse_speed

TIMEOUT_S = 5.0

SUBCOMMANDS = {
    "status": "show the state of the market",
    "pause": "pause before the next slot",
    "resume": "continue",
    "step": "run some slots, then pause",
    "speed": "change the speed",
    "stop": "end the market",
}


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid control",
        description="Control a running market, and show its state afterwards.",
        examples=["zengrid control pause", "zengrid control step 24", "zengrid control speed 3600x"],
    )
    commands = it.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, text in SUBCOMMANDS.items():
        argument = {"step": " 24", "speed": " 60x"}.get(name, "")
        command = commands.add_parser(
            name, help=text, description=f"{text.capitalize()}.", examples=[f"zengrid control {name}{argument}"]
        )
        if name == "step":
            command.add_argument("slots", nargs="?", type=WholeNumber(1), default=1, help="number of slots")
        if name == "speed":
            command.add_argument("speed", type=parse_speed, help="max, or a factor on real time such as 60x or 1x")
        add_bus_options(command)
    return it


def main(arguments: Sequence[str]) -> int:
    """Send the command to the clock, and print the state of the market afterwards."""
    options = parser().parse_args(arguments)
    from zengrid.bus.market_client import MarketClient
    from zengrid_cli.live_view.number_format import format_pace, format_progress

    with MarketClient(options.run, options.connect, certs=options.certs, timeout_s=TIMEOUT_S) as client:
        status = client.control(
            options.command, slots=getattr(options, "slots", 1), speed=getattr(options, "speed", None), homes=False
        )
    print(f"{status.scenario} ({status.run}): {status.state}, {format_pace(status)}, {format_progress(status)}")
    return 0
