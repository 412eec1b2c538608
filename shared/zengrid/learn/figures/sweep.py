"""The figure of a sweep: bills, profit and reserve energy over the first axis, a line for each value of the others."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from pandas.api.types import is_bool_dtype, is_numeric_dtype

from zengrid.learn.figures.style import DASHES, GREY, HOMES, LEADER, band, legend, letter, panels, save, style

if TYPE_CHECKING:
    import pandas as pd

MOST_LINES = len(HOMES)
PANELS = {
    "bill": ("all bills", "$/day"), "profit": ("grid profit", "$/day"), "reserve_kwh": ("reserve energy", "kWh/day"),
}  # fmt: skip
BESIDE = {"conventional": (GREY, (1.5, 1.5), "conventional"), "leader": (LEADER, (5, 2), "leader reference")}


def draw(table: pd.DataFrame, axes: Sequence[str], stem: Path) -> None:
    """Draw the table of a sweep into ``stem.png`` and so on.

    Parameters
    ----------
    table:
        As ``Sweep.table`` gives it.
    axes:
        Its axes, in order; none draws every seed at one place.
    stem:
        Path without suffix.
    """
    cells = table[table["figure"].isin(PANELS)].groupby([*axes, "seed", "figure"], dropna=False, sort=False)
    sums = cells[["agents", "conventional", "leader"]].sum(min_count=1).reset_index()
    with style():
        figure, places = panels(len(PANELS), width=9.0, height=3.2)
        for place, (name, (_, unit)) in zip(places, PANELS.items(), strict=True):
            _panel(place, sums[sums["figure"] == name], axes)
            place.set_ylabel(unit)
        letter(places, [title for title, _ in PANELS.values()])
        legend(figure, places, columns=4)
        save(figure, sums, stem)


def _panel(place: Axes, sums: pd.DataFrame, axes: Sequence[str]) -> None:
    first, others = (axes[0] if axes else "seed"), list(axes[1:])
    values = list(dict.fromkeys(sums[first]))
    numeric = is_numeric_dtype(sums[first]) and not is_bool_dtype(sums[first])
    where = values if numeric else list(range(len(values)))
    grouped = sums.groupby(others, sort=False, dropna=False) if others else [((), sums)]
    groups: list[tuple[Hashable, pd.DataFrame]] = list(grouped)
    for number, (key, group) in enumerate(groups[:MOST_LINES]):
        told = key if isinstance(key, tuple) else (key,)
        label = ", ".join(f"{_short(axis)} {value}" for axis, value in zip(others, told, strict=True)) or "agents"
        agents = _over_seeds(group, first, values, "agents")
        band(place, where, agents, HOMES[number], label, dashes=DASHES[number], marker="o")
    for column, (colour, dashes, label) in BESIDE.items():
        lines = [_over_seeds(group, first, values, column)[0] for _, group in groups[:MOST_LINES]]
        if np.isnan(lines).all():
            continue
        if all(np.allclose(line, lines[0], equal_nan=True) for line in lines):
            place.plot(where, lines[0], color=colour, dashes=dashes, label=label)
        else:  # each group has its own, in its own colour
            for number, line in enumerate(lines):
                place.plot(where, line, color=HOMES[number], dashes=dashes, linewidth=1.0)
    if len(groups) > MOST_LINES:
        place.annotate(f"and {len(groups) - MOST_LINES} more in the table", (0.02, 0.02), xycoords="axes fraction")
    place.set_xlabel(_short(first))
    if not numeric:
        place.set_xticks(where, [str(value) for value in values])


def _over_seeds(group: pd.DataFrame, first: str, values: Sequence[object], column: str) -> np.ndarray:
    """``(seed, value)``; seeds that lack a value are left out where others have it."""
    if first == "seed":
        return group[column].to_numpy(dtype=np.float64)[None]
    wide = group.pivot_table(index="seed", columns=first, values=column, aggfunc="mean", dropna=False, sort=False)
    return wide.reindex(columns=list(values)).to_numpy(dtype=np.float64)


def _short(axis: str) -> str:
    """``homes.*.battery.capacity_kwh`` -> ``capacity_kwh``."""
    return axis.rpartition(".")[2]
