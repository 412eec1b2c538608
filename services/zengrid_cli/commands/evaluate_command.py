"""``zengrid evaluate``: plays held-out days with policies, and compares them with the best possible ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.market_options import add_data_option
from zengrid.command_line.value_parsers import WholeNumber


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid evaluate",
        description="Play held-out days with policies, and compare them with the baseline (the market without demand "
        "response), with best responses, and with the leader reference (what the grid could earn if it knew how every "
        "home responds).",
        examples=[
            "zengrid evaluate runs/train-paper",
            "zengrid evaluate grid.safetensors prosumers.safetensors --scenario paper --json results.json",
        ],
    )
    what = it.add_argument_group("policies and market")
    what.add_argument(
        "policies", nargs="*", type=Path, metavar="FOLDER|FILE",
        help="folder of a training, or policy files (one of the grid, one of the prosumers); without any, the "
        "conventional rule is evaluated",
    )  # fmt: skip
    what.add_argument(
        "--kind", choices=["best", "last"], default="best", help="which policies of a folder: the best or the last ones"
    )
    what.add_argument(
        "--scenario", metavar="SCENARIO", help="scenario to play (default: the scenario of the training, or paper)"
    )
    add_data_option(what)
    what.add_argument(
        "--scenario-set", action="append", default=[], metavar="PATH=VALUE", dest="scenario_changes",
        help="change a field of the scenario, such as soc_reset=never; may be repeated",
    )  # fmt: skip
    what.add_argument("--days", type=WholeNumber(1), default=64, metavar="N", help="number of held-out days")
    what.add_argument("--no-leader", action="store_true", help="do not search for the leader reference")
    result = it.add_argument_group("results")
    result.add_argument("--json", type=Path, metavar="FILE", help="write all results as JSON")
    result.add_argument("--csv", type=Path, metavar="FILE", help="write one row for each market and agent")
    result.add_argument("--quiet", action="store_true", help="print no tables")
    return it


def main(arguments: Sequence[str]) -> int:
    """Evaluate, print tables and write files."""
    options = parser().parse_args(arguments)
    from zengrid_cli.report.evaluate_policies import evaluate_policies

    evaluate_policies(options)
    return 0
