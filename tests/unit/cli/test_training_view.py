"""The live view of a training: what a terminal shows of it."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

from rich.console import Console

from zengrid.learn.run import Plan, Report, Run
from zengrid.learn.settings import Settings
from zengrid.scenario import load
from zengrid_cli.training.training_view import TrainingView, remaining, sparkline

TINY = Settings.preset("fast").with_(days=2, pool=8, steps=96, memory=200, hidden=(8,), batch=4)


def shown(progress: TrainingView) -> list[str]:
    console = Console(file=StringIO(), width=100, color_system=None, highlight=False)
    with console.capture() as capture:
        console.print(progress)
    return [line.rstrip() for line in capture.get().splitlines()]


def test_a_training_as_a_terminal_shows_it(tmp_path: Path) -> None:
    run = Run(tmp_path, Plan((load("paper"),) * 2, (0, 1), TINY, "public", "zengrid train paper"))
    progress = TrainingView(run)
    (head,) = shown(progress)
    assert head.startswith("paper")
    assert "0 of 96 vector steps" in head
    reports: list[Report] = []

    def report(now: Report) -> None:
        reports.append(now)
        progress.add(now)

    assert run.go(report, every=2)
    lines = shown(progress)
    assert "96 of 96 vector steps" in lines[0]
    names = [line.split("  ")[0] for line in lines]
    for name in ("bill p1", "bill p2", "bill p3", "grid profit", "reserve energy", "largest gap of a home"):
        assert name in names
    profit = lines[names.index("grid profit")]
    worst = min(changes.profit for changes in reports[-1].best)
    assert f"{worst:+.1f} %" in profit
    assert profit.endswith("+37 %")
    assert lines[-1].startswith("joint gain ")


def test_a_curve_and_the_time_that_is_left() -> None:
    assert sparkline([0.0, 1.0, 2.0]) == "▁▅█"
    assert sparkline([3.0]) == "▁"
    assert len(sparkline([float(i) for i in range(100)])) == 32
    assert remaining(30.0, 0.75) == "about 10 s left"
    assert remaining(0.0, 0.0) == remaining(9.0, 1.0) == ""
