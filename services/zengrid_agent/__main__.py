"""``python -m zengrid_agent prosumer|grid``: runs one agent of a market."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small: threads only cost memory and time
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search for plugins takes longer than our messages

from zengrid import logs
from zengrid.command_line.bus_options import add_bus_options
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.learning_options import add_learning_options
from zengrid.command_line.log_options import add_log_options
from zengrid.command_line.run_command import run_command
from zengrid.command_line.value_parsers import Number, parse_integer

TRAINED = "trained"
RULES = {"prosumer": "conventional", "grid": "fixed"}
"""Default policies of agents that learn; all others use the shipped trained policies by default."""


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid",
        description="Run one agent of a running market.",
        examples=["zengrid prosumer --id p1", "zengrid grid"],
    )
    roles = it.add_subparsers(dest="role", required=True, metavar="ROLE")
    prosumer = roles.add_parser(
        "prosumer",
        help="command the batteries of one or more homes",
        description="Run a prosumer agent, which commands the batteries of one or more homes of a running market.",
        examples=[
            "zengrid prosumer --id p1",
            "zengrid prosumer --id p4 --pv 5 --battery 10",
            "zengrid prosumer --id p1 --policy conventional --connect tcp/192.0.2.10:7447",
        ],
    )
    prosumer.add_argument(
        "--id",
        required=True,
        metavar="ID",
        help="id of the agent; a home that it brings has the same id. auto: a home of the scenario that no agent "
        "has, or else a new home named after this machine",
    )
    _add_home_options(prosumer)
    grid = roles.add_parser(
        "grid",
        help="set the export price",
        description="Run the grid agent, which sets the export price of a running market.",
        examples=["zengrid grid", "zengrid grid --policy fixed:0.07"],
    )
    for name, role in (("prosumer", prosumer), ("grid", grid)):
        _add_agent_options(role, RULES[name])
        add_learning_options(role, learned="runs/RUN/learned")
        add_bus_options(role.add_argument_group("network"))
        add_log_options(role)
    return it


def _add_home_options(parser: CommandParser) -> None:
    home = parser.add_argument_group("a home that the agent brings (without these: the scenario's homes of its id)")
    home.add_argument("--pv", type=Number(unit="kW"), metavar="KW", help="rated power of its PV system")
    home.add_argument("--battery", type=Number(unit="kWh"), metavar="KWH", help="capacity of its battery")
    home.add_argument(
        "--battery-power",
        type=Number(unit="kW"),
        metavar="KW",
        help="largest charging and discharging power (default: 2)",
    )
    home.add_argument(
        "--load", metavar="PROFILE", help="load profile of the scenario's data (default: that of its first home)"
    )
    home.add_argument("--load-scale", type=Number(), metavar="FACTOR", help="factor on the load profile (default: 1)")
    home.add_argument("--seed", type=parse_integer, metavar="N", help="seed of the home's own noise (default: 0)")
    home.add_argument("--home", metavar="JSON", help="the home as in a scenario file, instead of the options above")


def _add_agent_options(parser: CommandParser, rule: str) -> None:
    parser.add_argument(
        "--policy",
        metavar="POLICY",
        help=f"name of a rule, of a shipped policy, or a policy file (default: trained; with --learn {rule})",
    )
    parser.add_argument(
        "--observation",
        choices=["paper", "public"],
        default="public",
        help="what the agent observes: public: with the prices that everybody knows; paper: as in the paper",
    )
    parser.add_argument(
        "--encoding",
        choices=["json", "binary"],
        default="json",
        help="encoding of its messages; binary is faster for fleets of many homes",
    )
    parser.add_argument(
        "--timeout",
        type=Number(above=True, unit="s"),
        default=30.0,
        metavar="SECONDS",
        help="longest wait for the clock",
    )


def main(arguments: Sequence[str]) -> int:
    """Run an agent until its market is over."""
    options = parser().parse_args(arguments)
    logs.configure(options.role, options, prefix="", run=options.run)
    if options.policy is None:
        options.policy = RULES[options.role] if options.learn else TRAINED
    if options.role == "grid":
        from zengrid_agent.grid import play
    else:
        from zengrid_agent.prosumer import play
    play(options)
    return 0


if __name__ == "__main__":
    sys.exit(run_command("agent", main, sys.argv[1:]))
