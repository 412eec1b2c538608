"""``zengrid scenario``: shows, checks and exports scenarios."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_data_option
from zengrid.command_line.value_parsers import WholeNumber

SCENARIO_HELP = "paper, fontana, village, city, or a YAML file"


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid scenario",
        description="Show, check and export scenarios.",
        examples=["zengrid scenario show village", "zengrid scenario check my-market.yaml --data measured"],
    )
    commands = it.add_subparsers(dest="command", required=True, metavar="COMMAND")
    show = commands.add_parser(
        "show",
        help="describe a scenario",
        description="Describe a scenario: its homes, consumers, facilities and prices, and one of its days.",
        examples=["zengrid scenario show", "zengrid scenario show village --day 3 --seed 7"],
    )
    check = commands.add_parser(
        "check",
        help="check a scenario and its data",
        description="Check a scenario and its data: exit code 0 if it can be played, 1 if not, with every error.",
        examples=["zengrid scenario check my-market.yaml --data measured"],
    )
    export = commands.add_parser(
        "export",
        help="write the profiles of some days",
        description="Write the profiles of some days, and a scenario file that plays them.",
        examples=["zengrid scenario export paper --days 7 --out week"],
    )
    show.add_argument("scenario", nargs="?", default="paper", help=SCENARIO_HELP)
    for command in (check, export):
        command.add_argument("scenario", help=SCENARIO_HELP)
    for command in (show, check, export):
        add_data_option(command)
    for command in (show, export):
        command.add_argument("--seed", type=WholeNumber(0), metavar="N", help="seed (default: the scenario's)")
    show.add_argument("--day", type=WholeNumber(0), default=0, metavar="N", help="number of the day that is drawn")
    export.add_argument("--out", type=Path, metavar="FOLDER", required=True, help="where to write")
    export.add_argument("--days", type=WholeNumber(1), default=1, metavar="N", help="number of days")
    export.add_argument("--first", type=WholeNumber(0), default=0, metavar="N", help="number of the first day")
    export.add_argument("--format", choices=["csv", "parquet"], default="csv", help="kind of files")
    return it


def main(arguments: Sequence[str]) -> int:
    """Run one of the subcommands."""
    options = parser().parse_args(arguments)
    {"show": _show, "check": _check, "export": _export}[options.command](options)
    return 0


def _show(options: argparse.Namespace) -> None:
    from zengrid.scenario import Days, load
    from zengrid_cli.report.scenario_tables import print_scenario

    scenario = load(options.scenario, data=options.data, seed=options.seed)
    print_scenario(scenario, Days(scenario), options.day)


def _check(options: argparse.Namespace) -> None:
    from rich.console import Console

    from zengrid.scenario import Days, load

    scenario = load(options.scenario, data=options.data)
    days = Days(scenario)
    days.day(0)
    count = "a typical day" if days.count is None else f"{days.count} measured days"
    Console().print(
        f"[green]{scenario.name} is fine[/]: {len(scenario.homes)} homes, {scenario.slots_per_day} slots a day, "
        f"{count}",
        highlight=False,
        soft_wrap=True,
    )


def _export(options: argparse.Namespace) -> None:
    from zengrid.scenario import load
    from zengrid.scenario.day_export import export_days

    scenario = load(options.scenario, data=options.data, seed=options.seed)
    for path in export_days(scenario, options.days, options.out, options.format, options.first):
        print(path)
