"""``python -m zengrid_agent prosumer|grid``: play one agent of a market."""

from __future__ import annotations

import argparse
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices here are small: threads only cost memory and time
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # looking for plugins takes longer than all our messages

from zengrid import logs
from zengrid.bus.options import add_bus_options
from zengrid.errors import ZengridError
from zengrid.learn.options import add_learning_options

TRAINED = "trained"
RULES = {"prosumer": "conventional", "grid": "fixed"}
"""What decides unless told otherwise: what comes trained with zengrid; for those who start from nothing, a rule."""


def parser() -> argparse.ArgumentParser:
    """The command line of agents."""
    it = argparse.ArgumentParser(prog="zengrid", description="Play one agent of a running market.")
    roles = it.add_subparsers(dest="role", required=True)
    prosumer = roles.add_parser("prosumer", help="command the battery of a home, or of several")
    prosumer.add_argument(
        "--id",
        required=True,
        help="name of the agent; a home it brings has the same name. auto: a home of the scenario that nobody plays; "
        "where there is none, one that it brings, named after this machine",
    )
    brought = prosumer.add_argument_group(
        "a home of its own (without these it plays the scenario's homes of that name)"
    )
    brought.add_argument("--pv", type=float, metavar="KW", help="rated power of its PV system")
    brought.add_argument("--battery", type=float, metavar="KWH", help="capacity of its battery")
    brought.add_argument(
        "--battery-power", type=float, metavar="KW", help="largest charging and discharging power (default: 2)"
    )
    brought.add_argument(
        "--load", metavar="PROFILE", help="load profile of the scenario's data (default: its first home's)"
    )
    brought.add_argument("--load-scale", type=float, metavar="FACTOR", help="factor on the load profile (default: 1)")
    brought.add_argument("--seed", type=int, help="changes the home's own noise (default: 0)")
    brought.add_argument("--home", metavar="JSON", help="instead of all these: the home as a scenario describes it")
    grid = roles.add_parser("grid", help="set the price at which the grid buys")
    for role in (prosumer, grid):
        role.add_argument(
            "--policy",
            metavar="POLICY",
            help="rule, policy that comes with zengrid, or policy file that decides (default: trained; with --learn, "
            f"{RULES['prosumer' if role is prosumer else 'grid']})",
        )
        role.add_argument(
            "--observation",
            choices=["paper", "public"],
            default="public",
            help="what it asks to see (default: %(default)s)",
        )
        role.add_argument(
            "--encoding",
            choices=["json", "binary"],
            default="json",
            help="binary suits fleets of many homes (default: %(default)s)",
        )
        role.add_argument(
            "--timeout",
            type=float,
            default=30.0,
            metavar="S",
            help="longest wait for the clock (default: %(default)s s)",
        )
        add_learning_options(role, learned="runs/RUN/learned")
        add_bus_options(role)
        logs.add_log_options(role)
    return it


def main(arguments: list[str] | None = None) -> int:
    """Play an agent until its market is over."""
    options = parser().parse_args(arguments)
    logs.begin(options.role, options, prefix="", run=options.run)
    if options.policy is None:
        options.policy = RULES[options.role] if options.learn else TRAINED
    try:
        if options.role == "grid":
            from zengrid_agent.grid import play
        else:
            from zengrid_agent.prosumer import play
        play(options)
    except ZengridError as error:
        logs.fail(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
