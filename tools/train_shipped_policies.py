"""Trains the policies that come with zengrid, and writes them into the package: ``make policies``."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from zengrid import __version__
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.value_parsers import WholeNumber
from zengrid.env.facts import market_facts
from zengrid.learn.evaluation import Evaluator, Trained
from zengrid.learn.generic import Generic, GenericTraining, drawn_market
from zengrid.learn.run import Plan, Run, use_threads
from zengrid.learn.settings import Settings
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import GridNetwork, ProsumerNetwork
from zengrid.policy.trained import FOLDER, GENERIC, GRID, PROSUMERS, batteries
from zengrid.scenario import Scenario, load

SEEDS = (0, 1, 2)
COMMAND = "make policies"
HELD_OUT_SEED = 1_000_003
"""Seed of the homes on which the policy for homes of any size is evaluated."""


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(description=__doc__, examples=[COMMAND, f"{COMMAND} ARGS=--evaluate"])
    it.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help="where to write (default: the package)")
    it.add_argument("--evaluate", action="store_true", help="only evaluate the existing policies")
    it.add_argument(
        "--generic",
        action="store_true",
        help="train only the policy for homes of any size, with the existing grid policy",
    )
    it.add_argument(
        "--markets",
        type=WholeNumber(1),
        default=24,
        metavar="N",
        help="number of markets of random homes to evaluate on",
    )
    return it


def main(arguments: Sequence[str]) -> int:
    """Train, write, evaluate; returns the exit code."""
    options = parser().parse_args(arguments)
    use_threads(1)
    # The live market goes on from day to day, so do the markets that its agents are trained in.
    scenario = load("paper").with_(soc_reset="never")
    options.out.mkdir(parents=True, exist_ok=True)
    if not (options.evaluate or options.generic):
        trained = case_study(scenario)
        save_policy(options.out, GRID, trained.grid)
        save_policy(options.out, PROSUMERS, trained.prosumers)
    if not options.evaluate:
        grid = PolicyFile.load(options.out / f"{GRID}.safetensors")
        save_policy(options.out, GENERIC, for_any_home(scenario, grid))
    grid, prosumers, generic = (
        PolicyFile.load(options.out / f"{name}.safetensors") for name in (GRID, PROSUMERS, GENERIC)
    )
    show_case_study(Trained(grid, prosumers))
    show_generic(scenario, grid, generic, options.markets)
    return 0


def case_study(scenario: Scenario) -> Trained:
    """Train the agents of the paper's market with several seeds; return those that are best on held-out days."""
    plan = Plan((scenario,) * len(SEEDS), SEEDS, Settings.preset("thorough"), "public", COMMAND)
    with tempfile.TemporaryDirectory() as name:
        run = Run(Path(name), plan)
        run.go(lambda report: print_progress(f"case study: step {report.step} of {report.steps}"))
        return best_of(run)


def best_of(run: Run) -> Trained:
    """The policies of the best seed, in the form of the package."""
    scenario = run.plan.scenarios[0]
    ranks = [(False, -np.inf) if best is None else best.rank for best in run.best]
    place = ranks.index(max(ranks))
    grid, prosumers = (
        PolicyFile.load(run.folder / f"best-{run.names(place)}-{part}.safetensors") for part in Trained._fields
    )
    training = {
        "scenario": scenario.name, "soc_reset": scenario.soc_reset, "seeds": list(SEEDS), "seed": SEEDS[place],
        "steps": run.training.step, "command": COMMAND, "version": __version__,
    }  # fmt: skip
    # The number of homes never changed in training: remove the influence of its untrained weights.
    scale = np.where([name == "homes" for name in grid.features], 0.0, grid.scale)
    scales = run.training.scales
    return Trained(
        replace(grid, name=GRID, scale=scale, training={**training, "reward_scale": scales.grid_reward}),
        replace(
            prosumers, name=PROSUMERS,
            training={
                **training, "reward_scale": scales.prosumer_reward, "batteries": batteries(scenario.market().homes),
            },
        ),
    )  # fmt: skip


def for_any_home(scenario: Scenario, grid: PolicyFile) -> PolicyFile:
    """Train the policy for homes of any size, with the prices of that grid agent and others."""
    training = GenericTraining(scenario, grid, Generic.default(), seed=SEEDS[0])
    reported = 0

    def report(progress: float) -> None:
        nonlocal reported
        if progress >= reported / 10:
            print_progress(f"homes of any size: {progress:.0%}")
            reported += 1

    training.train(report)
    return training.file({"grid": grid.version, "command": COMMAND, "version": __version__})


def show_case_study(trained: Trained) -> None:
    """Print the results of the case study's agents on held-out days."""
    for soc_reset in ("never", "daily"):
        found = Evaluator.held_out(load("paper").with_(soc_reset=soc_reset), 63).evaluate_trained(trained)
        bills = " ".join(f"{bill:+.0f}" for bill in found.changes.bill)
        gap = " ".join(f"{percent:.0f}" for percent in found.gap.percent) if found.gap else ""
        print(
            f"paper, soc_reset {soc_reset}: bills {bills} %, profit {found.changes.profit:+.0f} %, reserve "
            f"{found.changes.reserve:+.0f} %; gap to best response {gap} % of the saving"
        )


def show_generic(scenario: Scenario, grid: PolicyFile, generic: PolicyFile, markets: int) -> None:
    """Print the savings of random homes that were not in the training, against the conventional rule."""
    rng = np.random.default_rng(HELD_OUT_SEED)
    evaluators = [Evaluator.held_out(drawn_market(scenario, rng), 14) for _ in range(markets)]
    for prices in ("trained", "fixed"):
        saved, gaps = [], []
        for it in evaluators:
            setter = GridNetwork(grid, market_facts(it.scenario)) if prices == "trained" else None
            network = ProsumerNetwork(generic, market_facts(it.scenario, it.scenario.home_ids))
            found, rule = it.evaluate(setter, network), it.evaluate(setter, None, gaps=False)
            assert found.gap is not None
            saved.append(rule.agents.bill - found.agents.bill)
            gaps.append(found.gap.dollars)
        saving, gap = np.concatenate(saved), np.concatenate(gaps)
        ends = ", ".join(f"{value:+.3f}" for value in np.quantile(saving, [0.0, 0.1, 0.5, 0.9, 1.0]))
        print(
            f"{len(saving)} random homes, {prices} price: {np.mean(saving > 0.0):.0%} pay less than with the "
            f"conventional rule, by {saving.mean():.3f} $/day on average (least, 10 %, median, 90 %, most: {ends}); "
            f"{saving.sum() / (saving.sum() + gap.sum()):.0%} of what best responses save"
        )


def save_policy(folder: Path, name: str, file: PolicyFile) -> None:
    """Write a policy file."""
    path = folder / f"{name}.safetensors"
    file.save(path)
    print_progress(f"{path}: version {file.version}")


def print_progress(text: str) -> None:
    """Print a line to stderr."""
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
