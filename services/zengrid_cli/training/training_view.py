"""The live view of a training for a terminal: progress, results of the agents, and the paper's figures."""

from __future__ import annotations

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from zengrid.learn.evaluation import PAPER, Changes, reaches
from zengrid.learn.run import Report, Run

MOST_HOMES = 6
"""Largest number of homes with a line each; if there are more, only the worst one is shown."""
SPARKS = "▁▂▃▄▅▆▇█"
CURVE = 32
"""Largest number of characters of a curve."""


class TrainingView:
    """Shows the state of a training between two evaluations, and after the last."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self._gains: list[float] = []
        self._last: Report | None = None

    def add(self, report: Report) -> None:
        """Add an evaluation."""
        self._last = report
        self._gains.append(float(np.median([changes.joint_gain for changes in report.now])))

    def __rich__(self) -> RenderableType:
        """The whole view; the bar moves with every day."""
        training = self.run.training
        head = Table.grid(padding=(0, 1))
        head.add_row(
            Text(self.run.plan.scenarios[0].name, "bold"),
            ProgressBar(training.settings.steps, min(training.step, training.settings.steps), width=32),
            f"{100 * training.progress:3.0f} %",
            f"{training.step:,} of {training.settings.steps:,} vector steps",
            f"{self.run.seconds:.0f} s",
            remaining(self.run.seconds, training.progress),
        )
        if self._last is None:
            return head
        curve = Text.assemble(("joint gain ", "dim"), (sparkline(self._gains), "cyan"), f" {self._gains[-1]:+.1f} %")
        return Group(head, figure_table(self._last, self.run), curve)


def remaining(seconds: float, progress: float) -> str:
    """The remaining time at this pace."""
    return f"about {seconds * (1.0 / progress - 1.0):.0f} s left" if 0.0 < progress < 1.0 else ""


def figure_table(report: Report, run: Run) -> Table:
    """The paper's figures: now, of the kept policies, the worst of all markets, and as the paper reports them."""
    claims = PAPER if run.plan.scenarios[0].name == "paper" and len(report.now[0].bill) == len(PAPER.bill) else None
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1))
    table.add_column("change against the baseline", no_wrap=True)
    for heading in ("now", "kept", "worst kept", *(["paper"] if claims else [])):
        table.add_column(heading, justify="right", no_wrap=True, min_width=10)
    for name, now, kept, claim, good in _rows(report, run, claims):
        worst = max(kept) if good < 0 else min(kept)
        cells: list[RenderableType] = [f"{np.median(now):+.1f} %", f"{np.median(kept):+.1f} %"]
        reached = worst * good >= (claim or 0.0) * good
        cells.append(Text(f"{worst:+.1f} %", style="green" if reached else "red"))
        table.add_row(name, *cells, *([f"{claim:+.0f} %"] if claim is not None else []))
    now, kept = ([gap for gap in gaps if gap is not None] for gaps in (report.gap, report.best_gap))
    if now:
        cells = [f"{np.median(now):.1f} %", f"{np.median(kept):.1f} %", f"{max(kept):.1f} %"]
        table.add_row("largest gap of a home", *cells)
    if claims is not None:
        table.caption = f"the paper's figures: {sum(map(reaches, report.best))} of {len(report.best)} seeds"
    return table


def _rows(
    report: Report, run: Run, claims: Changes | None
) -> list[tuple[str, list[float], list[float], float | None, int]]:
    """Name, values of all markets now and kept, the paper's, and which sign is good."""
    now, kept, ids = report.now, report.best, run.plan.scenarios[0].home_ids
    found: list[tuple[str, list[float], list[float], float | None, int]] = []
    if len(ids) > MOST_HOMES:
        found.append(("worst bill", [max(c.bill) for c in now], [max(c.bill) for c in kept], None, -1))
    else:
        for place, home in enumerate(ids):
            claim = None if claims is None else float(claims.bill[place])
            found.append(
                (f"bill {home}", [float(c.bill[place]) for c in now], [float(c.bill[place]) for c in kept], claim, -1)
            )
    profit, reserve = (None, None) if claims is None else (claims.profit, claims.reserve)
    found.append(("grid profit", [c.profit for c in now], [c.profit for c in kept], profit, 1))
    found.append(("reserve energy", [c.reserve for c in now], [c.reserve for c in kept], reserve, -1))
    return found


def sparkline(values: list[float]) -> str:
    """A curve in a line of text; only the last values where there are too many."""
    last = values[-CURVE:]
    low, width = min(last), max(max(last) - min(last), 1e-9)
    return "".join(SPARKS[round((value - low) / width * (len(SPARKS) - 1))] for value in last)
