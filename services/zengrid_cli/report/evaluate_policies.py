"""Evaluates the policies that ``zengrid evaluate`` is given."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from zengrid.command_line.assignments import parse_assignments
from zengrid.env.facts import market_facts
from zengrid.errors import PolicyError
from zengrid.learn.evaluation import Evaluation, Evaluator
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import GridNetwork, ProsumerNetwork
from zengrid.scenario import Scenario, load
from zengrid.scenario.files import loads
from zengrid_cli.report.evaluation_files import as_dict, write_csv
from zengrid_cli.report.evaluation_tables import gap_table, result_table

WIDTH = 104
"""Number of characters that the tables need."""


def evaluate_policies(options: argparse.Namespace) -> None:
    """Evaluate the policies, then print tables and write files as the command line asks."""
    scenario, markets = select_markets(options)
    evaluator = Evaluator.held_out(scenario, options.days)
    found = {name: evaluate_market(evaluator, files) for name, files in markets.items()}
    leader = None if options.no_leader else evaluator.leader()
    if options.json:
        options.json.write_text(json.dumps(as_dict(scenario, evaluator, found, leader), indent=1))
    if options.csv:
        write_csv(options.csv, scenario, found)
    if options.quiet:
        return
    console = Console(highlight=False)
    # A pipe has no width to fit into.
    console.width = max(console.width, WIDTH)
    outcome = None if leader is None else leader.outcome
    for table in (
        result_table(scenario, list(found.values()), outcome),
        gap_table(scenario, list(found.values()), outcome),
    ):
        console.print(table)


def select_markets(options: argparse.Namespace) -> tuple[Scenario, dict[str, list[Path]]]:
    """The scenario, and the policy files of each market to evaluate."""
    scenario: Scenario | None = None
    markets: dict[str, list[Path]] = {}
    folders = [path for path in options.policies if path.is_dir()]
    for folder in folders:
        for file in sorted(folder.glob(f"{options.kind}-*-grid.safetensors")):
            name = file.name.removesuffix("-grid.safetensors")
            label = name.removeprefix(f"{options.kind}-")
            label = label if len(folders) == 1 else f"{folder.name}/{label}"
            markets[label] = [file, folder / f"{name}-prosumers.safetensors"]
        if not markets:
            raise PolicyError(f"folder {folder}: has no {options.kind}-*-grid.safetensors")
        scenario = scenario or training_scenario(folder)
    files = [path for path in options.policies if not path.is_dir()]
    if files or not markets:
        markets["policies" if files else "conventional"] = files
    if options.scenario or scenario is None:
        scenario = load(options.scenario or "paper", data=options.data)
    if options.scenario_changes:
        scenario = scenario.with_(**parse_assignments(options.scenario_changes))
    return scenario, markets


def training_scenario(folder: Path) -> Scenario | None:
    """The scenario in the folder of a training, if there is one."""
    path = folder / "scenario.yaml"
    return loads(path.read_text(encoding="utf-8"), where=str(path)) if path.exists() else None


def evaluate_market(evaluator: Evaluator, files: Sequence[Path]) -> Evaluation:
    """Evaluate the agents of one market; agents without a file use the conventional rule or price."""
    scenario = evaluator.scenario
    grid = prosumers = None
    for path in files:
        if PolicyFile.load(path).role == "grid":
            grid = GridNetwork.load(path, market_facts(scenario))
        else:
            prosumers = ProsumerNetwork.load(path, market_facts(scenario, scenario.home_ids))
    return evaluator.evaluate(grid, prosumers)
