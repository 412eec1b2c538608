"""Results of an evaluation as tables: money and energy, and optimality gaps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich import box
from rich.table import Table

from zengrid.learn.evaluation import PAPER, Evaluation, Outcome, reaches
from zengrid.scenario import Scenario

MOST_HOMES = 12
"""Largest number of homes with a row each."""


def result_table(scenario: Scenario, evaluations: Sequence[Evaluation], leader: Outcome | None) -> Table:
    """Bills, profit, reserve and energy: medians with the spread over the markets."""
    base = evaluations[0].conventional
    agents, changes = [e.agents for e in evaluations], [e.changes for e in evaluations]
    title = f"{scenario.name}, held-out days, {len(evaluations)} trained"
    table = _table(("baseline", "agents", "change", "spread", "leader", "paper"), title)
    claims = PAPER if scenario.name == "paper" and len(scenario.homes) == len(PAPER.bill) else None
    for place, home in enumerate(scenario.home_ids[:MOST_HOMES]):
        table.add_row(
            f"bill {home}",
            *_cells("$", base.bill[place], [a.bill[place] for a in agents], [c.bill[place] for c in changes]),
            "" if leader is None else f"{leader.bill[place]:,.3f} $",
            "" if claims is None else f"{claims.bill[place]:+.0f} %",
        )
    table.add_row(
        "grid profit",
        *_cells("$", base.profit, [a.profit for a in agents], [c.profit for c in changes]),
        "" if leader is None else f"{leader.profit:,.2f} $",
        "" if claims is None else f"{claims.profit:+.0f} %",
    )
    table.add_row(
        "reserve energy",
        *_cells("kWh", base.reserve_kwh, [a.reserve_kwh for a in agents], [c.reserve for c in changes]),
        "" if leader is None else f"{leader.reserve_kwh:,.2f} kWh",
        "" if claims is None else f"{claims.reserve:+.0f} %",
    )
    _add_energy_rows(table, base, agents)
    if claims is not None:
        table.caption = f"The paper's figures are reached by {sum(map(reaches, changes))} of {len(changes)}."
    return table


def _add_energy_rows(table: Table, base: Outcome, agents: Sequence[Outcome]) -> None:
    """Rows that neither the paper nor the leader reference has."""
    peaks = [a.reserve_peak_kw for a in agents]
    change = [100.0 * (peak / max(base.reserve_peak_kw, 1e-9) - 1.0) for peak in peaks]
    table.add_row("reserve peak", *_cells("kW", base.reserve_peak_kw, peaks, change))
    for name in ("curtailed_kwh", "unserved_kwh"):
        now = f"{np.median([getattr(a, name) for a in agents]):,.3f} kWh"
        table.add_row(name.removesuffix("_kwh"), f"{getattr(base, name):,.3f} kWh", now)
    own = f"{100 * np.median([a.self_consumption.mean() for a in agents]):.0f} %"
    table.add_row("self-consumption", f"{100 * base.self_consumption.mean():.0f} %", own)


def gap_table(scenario: Scenario, evaluations: Sequence[Evaluation], leader: Outcome | None) -> Table:
    """What a best response would still save, in dollars and as part of the saving."""
    headings = ("own commands", "of its saving", "worst", "any power", "of its saving", "worst")
    table = _table(headings, "Optimality gap: what a best response would still gain")
    own_gaps = [e.gap for e in evaluations if e.gap is not None]
    any_gaps = [e.gap_any_power for e in evaluations if e.gap_any_power is not None]
    for place, home in enumerate(scenario.home_ids[:MOST_HOMES]):
        cells: list[str] = []
        for gaps in (own_gaps, any_gaps):
            cells += [
                f"{np.median([gap.dollars[place] for gap in gaps]):.4f} $",
                f"{np.median([gap.percent[place] for gap in gaps]):.1f} %",
                f"{max(gap.percent[place] for gap in gaps):.1f} %",
            ]
        table.add_row(home, *cells)
    if leader is not None:
        short = [100.0 * (leader.profit - e.agents.profit) / abs(leader.profit) for e in evaluations]
        table.add_row("grid", "", f"{np.median(short):+.1f} %", f"{max(short):+.1f} %")
        table.caption = "The grid's: by how much its profit is below the leader reference (negative: above it)."
    return table


def _table(headings: Sequence[str], title: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=title)
    table.add_column("", no_wrap=True)
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _cells(unit: str, before: float, now: Sequence[float], change: Sequence[float]) -> tuple[str, str, str, str]:
    """The baseline, the median of the agents, the median of the change, and its spread."""
    return (
        f"{before:,.3f} {unit}",
        f"{np.median(now):,.3f} {unit}",
        f"{np.median(change):+.1f} %",
        f"{min(change):+.1f} … {max(change):+.1f} %",
    )
