"""Runs one training from the command line: progress in the terminal, Ctrl-C, and what to do next."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from rich.live import Live

from zengrid.command_line.assignments import parse_assignments
from zengrid.errors import EXIT_INTERRUPTED
from zengrid.learn.board import Board
from zengrid.learn.evaluation import Changes, reaches, spread
from zengrid.learn.run import Plan, Report, Run, use_threads
from zengrid.learn.settings import Settings
from zengrid.scenario import load
from zengrid_cli.training.stop_on_signal import stop_on_signal
from zengrid_cli.training.training_view import MOST_HOMES, TrainingView


def train(options: argparse.Namespace, command: str) -> int:
    """Train as the command line asks; return the exit code.

    Parameters
    ----------
    options:
        The arguments of ``zengrid train``.
    command:
        The same as it was typed.
    """
    use_threads(options.threads)
    folder = options.out or Path("runs") / f"train-{Path(options.scenario).stem}"
    if options.resume:
        run = Run.resume(folder, options.device)
    else:
        run = Run(folder, plan_training(options, command), options.device)
    return follow_training(run, options)


def plan_training(options: argparse.Namespace, command: str) -> Plan:
    """What the command line asks to train."""
    scenario = load(options.scenario, data=options.data)
    if options.scenario_changes:
        scenario = scenario.with_(**parse_assignments(options.scenario_changes))
    seeds = tuple(range(options.first_seed, options.first_seed + options.seeds))
    settings = Settings.preset(options.preset).with_(**parse_assignments(options.changes or []))
    return Plan((scenario,) * len(seeds), seeds, settings, options.observation, command)


def follow_training(run: Run, options: argparse.Namespace) -> int:
    """Train and show the progress until the end, the time limit or Ctrl-C; return the exit code."""
    board = Board(run.folder / "tensorboard")
    last: Report | None = None
    shown = ExitStack()
    view = _start_view(run, shown) if sys.stdout.isatty() and not options.quiet else None

    def on_report(report: Report) -> None:
        nonlocal last
        last = report
        board.add(report)
        if view is not None:
            view.add(report)
        elif not options.quiet:
            print(format_report(report, run), flush=True)

    with stop_on_signal() as stopping:
        try:
            with shown:
                done = run.go(on_report, stopping, options.every, options.time_limit)
        finally:
            board.close()
        stopped = stopping()
    if last is None:
        print(f"Nothing left to train in {run.folder}.")
        return 0
    if options.quiet:
        print(format_report(last, run))
    print(f"Policies: {run.folder}/best-*.safetensors. Compare them: zengrid evaluate {shlex.quote(str(run.folder))}")
    if len(run.plan.seeds) > 1:
        print(f"Highest rank: {_highest_rank(run)}")
    if not done:
        print(f"To continue: zengrid train --resume --out {shlex.quote(str(run.folder))}")
    return EXIT_INTERRUPTED if stopped else 0


def _highest_rank(run: Run) -> str:
    """Which seed has the best policies."""
    place = run.highest
    kept = run.best[place]
    assert kept is not None
    gap = "" if kept.gap is None else f", largest gap {kept.gap:.1f} % of a saving"
    return f"seed {run.plan.seeds[place]}{' (stable)' if kept.rank.settled else ''}{gap}"


def _start_view(run: Run, shown: ExitStack) -> TrainingView:
    """Start the live view in the terminal; it ends with the stack, and its last state stays on the screen."""
    view = TrainingView(run)
    shown.enter_context(Live(get_renderable=view.__rich__, refresh_per_second=2))
    return view


def format_report(report: Report, run: Run) -> str:
    """One evaluation as a line."""
    best = report.best
    text = (
        f"{100 * report.step / report.steps:4.0f} %  {report.seconds:6.1f} s  "
        f"{_format_bills(best)} %  profit {spread([c.profit for c in best])[1]:+.0f} %  "
        f"reserve {spread([c.reserve for c in best])[1]:+.0f} %"
    )
    if run.plan.scenarios[0].name == "paper":
        text += f"  the paper's figures: {sum(map(reaches, best))} of {len(best)} seeds"
    return f"{text}  {report.agent_steps / max(report.seconds, 1e-9) / 1e3:.0f}k agent steps/s"


def _format_bills(changes: Sequence[Changes]) -> str:
    homes = len(changes[0].bill)
    if homes > MOST_HOMES:
        return f"worst bill {spread([c.bill.max() for c in changes])[1]:+.0f}"
    return "bills " + " ".join(f"{spread([c.bill[home] for c in changes])[1]:+.0f}" for home in range(homes))
