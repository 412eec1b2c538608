"""Rounds in alternation, and the medians, spreads and tables that come of them."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence

Row = dict[str, float]
"""Figures of one run; empty where the run failed."""


def alternate(
    systems: Mapping[str, Callable[[], Row]], rounds: int, shown: tuple[str, str], label: str = ""
) -> dict[str, list[Row]]:
    """Run all systems one after the other, round after round, so that noise of the machine falls on all alike.

    Every second round runs in reverse order: a machine that slows down steadily favours nobody.

    Parameters
    ----------
    systems:
        Each measures once and returns its figures.
    rounds:
        How often each system runs.
    shown:
        Figure to print after each run, and its unit.
    label:
        What the progress lines say about this set of rounds.

    Returns
    -------
    The rows of each system, in the order of the rounds.
    """
    rows: dict[str, list[Row]] = {name: [] for name in systems}
    key, unit = shown
    for number in range(rounds):
        for name in list(systems) if number % 2 == 0 else reversed(list(systems)):
            row = systems[name]()
            rows[name].append(row)
            value = f"{row[key]:.4g} {unit}" if key in row else "failed"
            print(f"round {number + 1}{label and ', '}{label}, {name}: {value}", file=sys.stderr, flush=True)
    return rows


def values(rows: Iterable[Row], key: str) -> list[float]:
    """One figure of the rounds that have it."""
    return [row[key] for row in rows if key in row]


def median(rows: Iterable[Row], key: str) -> float | None:
    """Median of one figure over the rounds that have it; None where none has."""
    found = values(rows, key)
    return statistics.median(found) if found else None


def ratios(rows: Sequence[Row], others: Sequence[Row], key: str) -> list[float]:
    """Ratio ``rows / others`` of each round by itself, since a machine's speed drifts less within one than between two.

    Rounds in which either run failed are left out.
    """
    return [row[key] / other[key] for row, other in zip(rows, others, strict=True) if key in row and key in other]


def shown(value: float | None, digits: int = 0) -> str:
    """A figure for a table, or a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def median_and_range(rows: Iterable[Row], key: str, digits: int = 0) -> str:
    """``median (smallest-largest)`` of one figure."""
    found = values(rows, key)
    if not found:
        return "failed"
    return f"{statistics.median(found):.{digits}f} ({min(found):.{digits}f}-{max(found):.{digits}f})"


def markdown(columns: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    head = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*head, *("| " + " | ".join(line) + " |" for line in lines)])
