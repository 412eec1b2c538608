"""The table of a sweep: one row for each cell, seed, agent and figure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

    from zengrid.learn.sweep.sweep import Done

NAN = float("nan")
MARKET_FIGURES = {
    "profit": "$/day", "reserve_kwh": "kWh/day", "reserve_peak_kw": "kW", "curtailed_kwh": "kWh/day",
    "unserved_kwh": "kWh/day",
}  # fmt: skip


def rows(done: Done) -> Iterator[dict[str, Any]]:
    """Rows of one market.

    Columns: one for each axis; ``seed``; ``agent`` (a home, or ``grid``); ``figure`` and its ``unit``; its value with
    the trained ``agents``, under ``conventional``, and where prosumers best-respond to the ``leader`` reference;
    ``change_percent`` against conventional; for bills the ``best_response`` to the prices that the trained grid set,
    among the commands that agents have, and ``gap_percent``, what that would still save in per cent of what is saved.
    """
    evaluation = done.evaluation
    agents, conventional, gap = evaluation["agents"], evaluation["conventional"], evaluation["gap"]
    led = None if done.leader is None else done.leader["outcome"]
    first = {**{axis: _single(value) for axis, value in done.market.cell.values.items()}, "seed": done.market.seed}

    def row(agent: str, figure: str, unit: str, place: int | None, **more: float) -> dict[str, Any]:
        now, before, best = (
            NAN if all_ is None else all_[figure] if place is None else all_[figure][place]
            for all_ in (agents, conventional, led)
        )  # fmt: skip
        change = 100.0 * (now - before) / abs(before) if before else NAN
        return {
            **first, "agent": agent, "figure": figure, "unit": unit, "agents": now, "conventional": before,
            "change_percent": change, "leader": best, "best_response": NAN, "gap_percent": NAN, **more,
        }  # fmt: skip

    for place, home in enumerate(done.market.cell.scenario.home_ids):
        dollars, percent = gap["dollars"][place], gap["percent"][place]
        best = agents["bill"][place] - dollars
        yield row(home, "bill", "$/day", place, best_response=best, gap_percent=percent)
        yield row(home, "self_consumption", "", place)
    for figure, unit in MARKET_FIGURES.items():
        yield row("grid", figure, unit, None)


def _single(value: Any) -> Any:
    """Lists and mappings as text: a column holds single values."""
    return value if isinstance(value, (bool, int, float, str)) or value is None else str(value)


def save(table: pd.DataFrame, stem: Path) -> list[Path]:
    """Write it as CSV and as Parquet; returns both paths."""
    paths = [stem.with_suffix(".csv"), stem.with_suffix(".parquet")]
    table.to_csv(paths[0], index=False)
    # A column of Parquet has one type; an axis may have numbers beside words.
    mixed = [name for name in table if table[name].dtype == object and name not in ("agent", "figure", "unit")]
    table.astype(dict.fromkeys(mixed, str)).to_parquet(paths[1], index=False)
    return paths
