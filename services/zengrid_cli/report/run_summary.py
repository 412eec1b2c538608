"""The summary at the end of ``zengrid up``: the results of the market beside the baseline."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from zengrid.errors import JournalError
from zengrid.journal import Journal, RunInfo
from zengrid_cli.report.run_results import ComparedSum, RunResults, add_up_run, latest_run

if TYPE_CHECKING:
    from rich.table import Table

MOST_HOMES = 12
"""Largest number of homes with a row each; if there are more, only their sum is shown."""


def print_summary(journal_place: str, run_name: str, command: str, since: float) -> None:
    """Print the summary of the run that ended, if it has settled a slot.

    Parameters
    ----------
    journal_place:
        File or URL of the journal.
    run_name:
        Name of the market.
    command:
        The command line as it was typed.
    since:
        When it was typed. [s, Unix time]
    """
    try:
        journal = Journal.open(journal_place, read_only=True)
    except JournalError:
        return  # The clock has reported it.
    with journal:
        run = latest_run(journal, run_name)
        last = None if run is None else run.last()
        if run is None or last is None or last.settled_at < since:
            print("No slot was settled.")
            return
        found = add_up_run(run)
    from rich.console import Console

    console = Console(highlight=False)
    console.print(summary_table(found))
    for line in remarks(found, run.info, journal_place, command, since):
        console.print(line, soft_wrap=True, markup=False)


def summary_table(found: RunResults) -> Table:
    """Bills, profit and reserve energy, beside the baseline."""
    from rich import box
    from rich.table import Table

    it = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    it.add_column("")
    for heading in ("this market", "baseline", "difference", ""):
        it.add_column(heading, justify="right")
    if len(found.bills) <= MOST_HOMES:
        for home, pair in found.bills.items():
            it.add_row(f"bill {home}", *_cells(pair, "$", good=-1))
    it.add_row(f"bills of {len(found.bills):,} homes", *_cells(found.all_bills, "$", good=-1), end_section=True)
    it.add_row("grid profit", *_cells(found.profit, "$", good=1))
    it.add_row("reserve energy", *_cells(found.reserve, "kWh", good=-1))
    return it


def remarks(found: RunResults, info: RunInfo, journal: str, command: str, since: float) -> list[str]:
    """Lines below the table: slots, fallbacks, journal, and how to continue."""
    hours = found.slots * info.dt_h
    lines = [f"{found.slots:,} slots ({hours / 24:.3g} days) settled; run {info.name}, seed {info.seed}."]
    if found.first_settled_at is not None and info.started_at >= since:
        lines[0] += f" First slot after {found.first_settled_at - since:.2f} s."
    missed = sum(found.fallbacks.values())
    if missed or found.grid_fallbacks:
        lines.append(
            f"Fallback used: in {missed} of {found.slots * len(found.bills)} slots of homes, "
            f"in {found.grid_fallbacks} of {found.slots} of the grid agent."
        )
    if found.curtailed_kwh > 0.0005 or found.unserved_kwh > 0.0005:
        lines.append(f"Curtailed {found.curtailed_kwh:.3f} kWh, unserved {found.unserved_kwh:.3f} kWh.")
    where = "" if journal == "zengrid.db" else f" --journal {shlex.quote(journal)}"
    lines.append(f"Journal: {journal}. As CSV: zengrid export --run {info.name}{where}")
    if info.finished_at is None:
        again = command if "--resume" in command else f"{command} --resume"
        lines.append(f"To continue where it ended: {again}")
    return lines


def _cells(pair: ComparedSum, unit: str, good: int) -> tuple[str, ...]:
    colour = "green" if pair.difference * good > 0 else "red" if pair.difference * good < 0 else "default"
    percent = "" if pair.percent is None else f"{pair.percent:+.1f} %"
    return (
        f"{pair.real:,.2f} {unit}",
        f"{pair.baseline:,.2f} {unit}",
        f"[{colour}]{pair.difference:+,.2f} {unit}[/]",
        f"[{colour}]{percent}[/]",
    )
