"""``zengrid evaluate``: policies on held-out days, beside the conventional rule and the best possible."""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid.errors import PolicyError
from zengrid_cli.options import parse_count
from zengrid_cli.train import pairs

if TYPE_CHECKING:
    from rich.table import Table

    from zengrid.learn.evaluation import Evaluation, Evaluator, Leader, Outcome
    from zengrid.scenario import Scenario

KINDS = ("best", "last")
WIDTH = 104
"""Characters that the tables need."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid evaluate",
        description="Play held-out days with policies, and compare with conventional, best responses and a leader.",
    )
    it.add_argument(
        "policies", nargs="*", type=Path, metavar="FOLDER|FILE",
        help="folder of a training, or policy files (one of the grid, one of the prosumers); "
        "without any, the conventional market",
    )  # fmt: skip
    it.add_argument("--scenario", default=None, help="market to play (default: what they were trained in, or paper)")
    it.add_argument("--data", type=Path, metavar="DIR", help="folder with the scenario's measured data")
    it.add_argument(
        "--scenario-set", action="append", default=[], metavar="PATH=VALUE", dest="scenario_changes",
        help="one field of the scenario, such as soc_reset=never",
    )  # fmt: skip
    it.add_argument("--kind", choices=KINDS, default="best", help="which policies of a folder (default: %(default)s)")
    it.add_argument("--days", type=parse_count, default=64, metavar="N", help="held-out days (default: %(default)s)")
    it.add_argument("--no-leader", action="store_true", help="leave out the search for the leader reference")
    it.add_argument("--json", type=Path, metavar="FILE", help="write everything as JSON")
    it.add_argument("--csv", type=Path, metavar="FILE", help="write one row for each seed and agent")
    it.add_argument("--quiet", action="store_true", help="no table")
    return it


def main(arguments: Sequence[str]) -> int:
    """Evaluate; returns the exit code."""
    options = parser().parse_args(arguments)
    from zengrid.learn.evaluation import Evaluator

    scenario, markets = find(options)
    evaluator = Evaluator.held_out(scenario, options.days)
    found = {name: evaluate(evaluator, files) for name, files in markets.items()}
    leader = None if options.no_leader else evaluator.leader()
    if options.json:
        options.json.write_text(json.dumps(as_dict(scenario, evaluator, found, leader), indent=1))
    if options.csv:
        write_csv(options.csv, scenario, found)
    if not options.quiet:
        from rich.console import Console

        console = Console(highlight=False)
        # In a pipe there is no terminal to fit into.
        console.width = max(console.width, WIDTH)
        for shown in tables(scenario, found, leader):
            console.print(shown)
    return 0


def find(options: argparse.Namespace) -> tuple[Scenario, dict[str, list[Path]]]:
    """The scenario, and the policy files of each market to evaluate."""
    from zengrid.scenario import load

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
            raise PolicyError(f"folder {folder}: holds no {options.kind}-*-grid.safetensors")
        scenario = scenario or trained_in(folder)
    files = [path for path in options.policies if not path.is_dir()]
    if files or not markets:
        markets["policies" if files else "conventional"] = files
    if options.scenario or scenario is None:
        scenario = load(options.scenario or "paper", data=options.data)
    if options.scenario_changes:
        scenario = scenario.with_(**pairs(options.scenario_changes))
    return scenario, markets


def trained_in(folder: Path) -> Scenario | None:
    """The scenario that a training left in its folder."""
    from zengrid.scenario.files import loads

    path = folder / "scenario.yaml"
    return loads(path.read_text(encoding="utf-8"), where=str(path)) if path.exists() else None


def evaluate(evaluator: Evaluator, files: Sequence[Path]) -> Evaluation:
    """What the agents of one market come to; who has no file plays the conventional rule or price."""
    from zengrid.env.facts import market_facts
    from zengrid.policy.file import PolicyFile
    from zengrid.policy.network import GridNetwork, ProsumerNetwork

    scenario = evaluator.scenario
    grid = prosumers = None
    for path in files:
        if PolicyFile.load(path).role == "grid":
            grid = GridNetwork.load(path, market_facts(scenario))
        else:
            prosumers = ProsumerNetwork.load(path, market_facts(scenario, scenario.home_ids))
    return evaluator.evaluate(grid, prosumers)


def tables(scenario: Scenario, found: dict[str, Evaluation], leader: Leader | None) -> list[Table]:
    """Money and energy, and the gaps; medians with the spread over the markets."""
    from rich import box
    from rich.table import Table

    from zengrid.learn.evaluation import PAPER, reaches

    every = list(found.values())
    led: Outcome | None = None if leader is None else leader.outcome
    base = every[0].conventional
    money = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=f"{scenario.name}, held-out days, {len(every)} trained")
    for heading in ("", "conventional", "agents", "change", "spread", "leader", "paper"):
        money.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    claims = PAPER if scenario.name == "paper" and len(scenario.homes) == len(PAPER.bill) else None

    def row(name: str, unit: str, before: float, now: list[float], change: list[float], led: str, claim: str) -> None:
        money.add_row(
            name, f"{before:,.3f} {unit}", f"{np.median(now):,.3f} {unit}", f"{np.median(change):+.1f} %",
            f"{min(change):+.1f} … {max(change):+.1f} %", led, claim,
        )  # fmt: skip

    for place, home in enumerate(scenario.home_ids[:12]):
        row(
            f"bill {home}", "$", base.bill[place], [e.agents.bill[place] for e in every],
            [e.changes.bill[place] for e in every], "" if led is None else f"{led.bill[place]:,.3f} $",
            "" if claims is None else f"{claims.bill[place]:+.0f} %",
        )  # fmt: skip
    row(
        "grid profit", "$", base.profit, [e.agents.profit for e in every], [e.changes.profit for e in every],
        "" if led is None else f"{led.profit:,.2f} $", "" if claims is None else f"{claims.profit:+.0f} %",
    )  # fmt: skip
    row(
        "reserve energy", "kWh", base.reserve_kwh, [e.agents.reserve_kwh for e in every],
        [e.changes.reserve for e in every], "" if led is None else f"{led.reserve_kwh:,.2f} kWh",
        "" if claims is None else f"{claims.reserve:+.0f} %",
    )  # fmt: skip
    peak = [100.0 * (e.agents.reserve_peak_kw / max(base.reserve_peak_kw, 1e-9) - 1.0) for e in every]
    row("reserve peak", "kW", base.reserve_peak_kw, [e.agents.reserve_peak_kw for e in every], peak, "", "")
    for name in ("curtailed_kwh", "unserved_kwh"):
        now = f"{np.median([getattr(e.agents, name) for e in every]):,.3f} kWh"
        money.add_row(name.removesuffix("_kwh"), f"{getattr(base, name):,.3f} kWh", now, "", "", "", "")
    own = f"{100 * np.median([e.agents.self_consumption.mean() for e in every]):.0f} %"
    money.add_row("self-consumption", f"{100 * base.self_consumption.mean():.0f} %", own, "", "", "", "")
    if claims is not None:
        money.caption = f"The paper's figures are reached by {sum(reaches(e.changes) for e in every)} of {len(every)}."

    gaps = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="Optimality gap: what a best response would still gain")
    for heading in ("", "own commands", "of its saving", "worst", "any power", "of its saving", "worst"):
        gaps.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for place, home in enumerate(scenario.home_ids[:12]):
        own_gaps = [e.gap for e in every if e.gap is not None]
        any_gaps = [e.gap_any_power for e in every if e.gap_any_power is not None]
        gaps.add_row(
            home,
            f"{np.median([g.dollars[place] for g in own_gaps]):.4f} $",
            f"{np.median([g.percent[place] for g in own_gaps]):.1f} %",
            f"{max(g.percent[place] for g in own_gaps):.1f} %",
            f"{np.median([g.dollars[place] for g in any_gaps]):.4f} $",
            f"{np.median([g.percent[place] for g in any_gaps]):.1f} %",
            f"{max(g.percent[place] for g in any_gaps):.1f} %",
        )
    if led is not None:
        short = [100.0 * (led.profit - e.agents.profit) / abs(led.profit) for e in every]
        gaps.add_row("grid", "", f"{np.median(short):+.1f} %", f"{max(short):+.1f} %")
        gaps.caption = "The grid's: how far its profit falls short of the leader reference (negative: beyond it)."
    return [money, gaps]


def as_dict(
    scenario: Scenario, evaluator: Evaluator, found: dict[str, Evaluation], leader: Leader | None
) -> dict[str, Any]:
    """Everything, as plain values."""
    from zengrid.learn.evaluation import plain

    return {
        "scenario": scenario.name,
        "homes": list(scenario.home_ids),
        "days": evaluator.numbers.ravel().tolist(),
        "soc_reset": scenario.soc_reset,
        "markets": {name: evaluation.as_dict() for name, evaluation in found.items()},
        "leader_reference": None
        if leader is None
        else {"buy_price": leader.buy_price.tolist(), "outcome": plain(leader.outcome)},
    }


def write_csv(path: Path, scenario: Scenario, found: dict[str, Evaluation]) -> None:
    """One row for each market and agent."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["market", "agent", "figure", "conventional", "agents", "change_percent", "gap", "gap_percent"])
        for name, e in found.items():
            for place, home in enumerate(scenario.home_ids):
                gap = (
                    [] if e.gap_any_power is None else [e.gap_any_power.dollars[place], e.gap_any_power.percent[place]]
                )
                numbers = [e.conventional.bill[place], e.agents.bill[place], e.changes.bill[place], *gap]
                table.writerow([name, home, "bill", *map(float, numbers)])
            table.writerow([name, "grid", "profit", e.conventional.profit, e.agents.profit, e.changes.profit])
            reserve = (e.conventional.reserve_kwh, e.agents.reserve_kwh, e.changes.reserve)
            table.writerow([name, "grid", "reserve_kwh", *reserve])
