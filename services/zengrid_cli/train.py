"""``zengrid train``: agents learn in a simulated market; progress, checkpoints, and policy files to play with."""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, Any

from zengrid.errors import PolicyError
from zengrid_cli.options import parse_count

if TYPE_CHECKING:
    from zengrid.learn.evaluation import Changes
    from zengrid.learn.run import Plan, Report, Run
    from zengrid_cli.progress import Progress


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid train",
        description="Train a grid agent and prosumer agents. Several seeds are trained at once, side by side.",
    )
    it.add_argument(
        "scenario", nargs="?", default="paper", help="built-in scenario or YAML file (default: %(default)s)"
    )
    it.add_argument("--data", type=Path, metavar="DIR", help="folder with the scenario's measured data")
    it.add_argument("--seeds", type=parse_count, default=1, metavar="N", help="so many seeds (default: %(default)s)")
    it.add_argument("--first-seed", type=int, default=0, metavar="N", help="the first of them (default: %(default)s)")
    it.add_argument(
        "--preset", default="fast",
        help="fast; thorough: five times as long, near an equilibrium; paper: as the authors print it (default: fast)",
    )  # fmt: skip
    it.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", dest="changes",
        help="one learning setting, such as steps=9000, lr=1e-3, grid_epsilon_end=0.05; may be given again",
    )  # fmt: skip
    it.add_argument(
        "--scenario-set", action="append", default=[], metavar="PATH=VALUE", dest="scenario_changes",
        help="one field of the scenario, such as soc_reset=never or homes.*.battery.capacity_kwh=10",
    )  # fmt: skip
    it.add_argument("--observation", choices=["public", "paper"], default="public", help="what agents see")
    it.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: runs/train-SCENARIO)")
    it.add_argument("--resume", action="store_true", help="go on exactly where the training in that folder stopped")
    it.add_argument("--time-limit", type=parse_seconds, metavar="S", help="end after so many seconds of training")
    it.add_argument(
        "--every", type=parse_count, default=5, metavar="DAYS", help="days between evaluations (default: 5)"
    )
    it.add_argument("--device", default="cpu", help="cpu, or cuda where there is one (default: %(default)s)")
    it.add_argument(
        "--threads", type=parse_count, default=1, metavar="N", help="of the processor (default: %(default)s)"
    )
    it.add_argument("--quiet", action="store_true", help="only the last line")
    return it


def main(arguments: Sequence[str]) -> int:
    """Train; returns the exit code."""
    options = parser().parse_args(arguments)
    learn = learning()
    learn.use_threads(options.threads)
    folder = options.out or Path("runs") / f"train-{Path(options.scenario).stem}"
    if options.resume:
        run = learn.Run.resume(folder, options.device)
    else:
        run = learn.Run(folder, plan(options, shlex.join(["zengrid", "train", *arguments])), options.device)
    return follow(run, options)


def parse_seconds(text: str) -> float:
    """A time above zero. [s]"""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not seconds > 0:
        raise argparse.ArgumentTypeError(f"{text}: give a number of seconds above 0")
    return seconds


def learning() -> ModuleType:
    """What learns, or a clear error where torch is missing."""
    try:
        return import_module("zengrid.learn.run")
    except ImportError as error:
        if error.name != "torch":
            raise
        raise PolicyError("torch is not installed; needed: pip install 'zengrid[learn]'") from None


def plan(options: argparse.Namespace, command: str) -> Plan:
    """What is to be trained."""
    from zengrid.learn.run import Plan
    from zengrid.learn.settings import Settings
    from zengrid.scenario import load

    scenario = load(options.scenario, data=options.data)
    if options.scenario_changes:
        scenario = scenario.with_(**pairs(options.scenario_changes))
    seeds = tuple(range(options.first_seed, options.first_seed + options.seeds))
    settings = Settings.preset(options.preset).with_(**pairs(options.changes))
    return Plan((scenario,) * len(seeds), seeds, settings, options.observation, command)


def pairs(texts: Sequence[str]) -> dict[str, Any]:
    """``["lr=1e-3"]`` -> ``{"lr": 0.001}``; values are read as YAML."""
    import yaml

    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise PolicyError(f"{text}: give NAME=VALUE")
        try:
            found[name] = float(value)
            if found[name].is_integer() and not set(value) & set(".eE"):
                found[name] = int(value)
        except ValueError:
            found[name] = yaml.safe_load(value)
        if isinstance(found[name], list):
            found[name] = tuple(found[name])
    return found


def follow(run: Run, options: argparse.Namespace) -> int:
    """Train and show how it goes, until the end, the time limit or Ctrl-C."""
    from zengrid.learn.board import Board

    stopping = False

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal stopping
        stopping = True

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    board = Board(run.folder / "tensorboard")
    last: Report | None = None
    shown = ExitStack()
    progress = live(run, shown) if sys.stdout.isatty() and not options.quiet else None

    def report(now: Report) -> None:
        nonlocal last
        last = now
        board.add(now)
        if progress is not None:
            progress.add(now)
        elif not options.quiet:
            print(line(now, run), flush=True)

    try:
        with shown:
            done = run.go(report, lambda: stopping, options.every, options.time_limit)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        board.close()
    if last is None:
        print(f"Nothing left to train in {run.folder}.")
        return 0
    if options.quiet:
        print(line(last, run))
    print(f"Policies: {run.folder}/best-*.safetensors. Compare them: zengrid evaluate {shlex.quote(str(run.folder))}")
    if len(run.plan.seeds) > 1:
        print(f"Highest rank: {highest(run)}")
    if not done:
        print(f"To go on: zengrid train --resume --out {shlex.quote(str(run.folder))}")
    return 130 if stopping else 0


def highest(run: Run) -> str:
    """Which seed's policies to play with."""
    place = run.highest
    kept = run.best[place]
    assert kept is not None
    gap = "" if kept.gap is None else f", largest gap {kept.gap:.1f} % of a saving"
    return f"seed {run.plan.seeds[place]}{' (settled)' if kept.rank.settled else ''}{gap}"


def live(run: Run, shown: ExitStack) -> Progress:
    """Begin the live view of a terminal; it stays until the stack is closed, and what it showed last remains."""
    from rich.live import Live

    from zengrid_cli.progress import Progress

    progress = Progress(run)
    shown.enter_context(Live(get_renderable=progress.__rich__, refresh_per_second=2))
    return progress


def line(now: Report, run: Run) -> str:
    """One evaluation in a line."""
    from zengrid.learn.evaluation import reaches, spread

    def bills(changes: Sequence[Changes]) -> str:
        if len(changes[0].bill) > 6:
            return "worst bill " + f"{spread([c.bill.max() for c in changes])[1]:+.0f}"
        return "bills " + " ".join(
            f"{spread([c.bill[i] for c in changes])[1]:+.0f}" for i in range(len(changes[0].bill))
        )

    best = now.best
    text = (
        f"{100 * now.step / now.steps:4.0f} %  {now.seconds:6.1f} s  "
        f"{bills(best)} %  profit {spread([c.profit for c in best])[1]:+.0f} %  "
        f"reserve {spread([c.reserve for c in best])[1]:+.0f} %"
    )
    if run.plan.scenarios[0].name == "paper":
        text += f"  the paper's figures: {sum(map(reaches, best))} of {len(best)} seeds"
    return f"{text}  {now.agent_steps / max(now.seconds, 1e-9) / 1e3:.0f}k agent steps/s"
