"""Every number of a reproduction as plain values: what the report and the figures show."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from zengrid import __version__
from zengrid.core.baselines import BASELINE_BUY_PRICE
from zengrid.learn.evaluation import PAPER
from zengrid.learn.reproduce.study import CAPACITY, Study

FLAT = 0.1
"""A curve is called flat from where on it stays within this share of its whole change around its end: about as much as
seeds differ. [-]"""
PAPER_FLAT_KWH = 15.0
"""Where the paper sees both curves flatten. [kWh]"""


def numbers(study: Study, wall_s: float) -> dict[str, Any]:
    """All results.

    Parameters
    ----------
    study:
        With all jobs done.
    wall_s:
        How long that took, interruptions left out. [s]
    """
    table = study.paper.table()
    sizes = study.capacity.table()
    return {
        "command": study.command,
        "version": __version__,
        "seeds": list(study.seeds),
        "held_out_days": study.days,
        "observation": study.observation,
        "settings": study.settings.as_dict(),
        "machine": machine(),
        "time": {"wall_s": round(wall_s, 1), "cpu_s": round(study.paper.cpu_s + study.capacity.cpu_s, 1)},
        "baseline_buy_price": BASELINE_BUY_PRICE,
        "figures": figures(table, study.scenario.home_ids),
        "seeds_reaching_all": all_reached(table, study.scenario.home_ids),
        "grid_short_of_leader_percent": short_of_leader(table),
        "capacity": capacity(sizes),
        "flat_from_kwh": flat_from(sizes),
        "policies": policies(study),
    }


def machine() -> dict[str, Any]:
    """What it ran on."""
    return {
        "processors": os.cpu_count(), "architecture": platform.machine(), "python": platform.python_version(),
        "numpy": np.__version__, "torch": version("torch"),
    }  # fmt: skip


def claims(homes: Sequence[str]) -> dict[tuple[str, str], float]:
    """What the paper reports for each agent and figure. [%]"""
    bills = {(home, "bill"): float(claim) for home, claim in zip(homes, PAPER.bill, strict=True)}
    return {**bills, ("grid", "profit"): PAPER.profit, ("grid", "reserve_kwh"): PAPER.reserve}


def reached(figure: str, change: ArrayLike, claim: float) -> np.ndarray:
    """Whether changes are as good as claimed: profit is to rise, all else to fall."""
    values = np.asarray(change)
    return values >= claim if figure == "profit" else values <= claim


def figures(table: pd.DataFrame, homes: Sequence[str]) -> list[dict[str, Any]]:
    """The paper's five figures: the paper's, ours, and the bounds."""
    found = []
    for (agent, figure), claim in claims(homes).items():
        rows = table[(table["agent"] == agent) & (table["figure"] == figure)]
        before, leader = float(rows["conventional"].iloc[0]), float(rows["leader"].iloc[0])
        entry = {
            "agent": agent, "figure": figure, "unit": rows["unit"].iloc[0], "paper_percent": claim,
            "conventional": before, "agents": spread(rows["agents"]), "change_percent": spread(rows["change_percent"]),
            "leader": leader, "leader_percent": 100.0 * (leader - before) / abs(before),
            "reached_by": int(reached(figure, rows["change_percent"], claim).sum()),
        }  # fmt: skip
        if figure == "bill":
            entry["best_response"] = spread(rows["best_response"])
            best_percent = 100.0 * (rows["best_response"] - rows["conventional"]) / rows["conventional"].abs()
            entry["best_response_percent"] = spread(best_percent)
            entry["gap_percent"] = spread(rows["gap_percent"])
        found.append(entry)
    return found


def all_reached(table: pd.DataFrame, homes: Sequence[str]) -> int:
    """How many seeds are as good as the paper in all five figures."""
    good = pd.Series(True, index=sorted(table["seed"].unique()))
    for (agent, figure), claim in claims(homes).items():
        rows = table[(table["agent"] == agent) & (table["figure"] == figure)].set_index("seed")["change_percent"]
        good &= pd.Series(reached(figure, rows, claim), index=rows.index)
    return int(good.sum())


def short_of_leader(table: pd.DataFrame) -> dict[str, float | None]:
    """How far the grid's profit falls short of the leader reference; negative: beyond it. [%]"""
    rows = table[(table["agent"] == "grid") & (table["figure"] == "profit")]
    return spread(100.0 * (rows["leader"] - rows["agents"]) / rows["leader"].abs())


def capacity(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Bills, profit and reserve energy for each size of the batteries."""
    found = []
    chosen = table[table["figure"].isin(("bill", "profit", "reserve_kwh"))]
    for (size, agent, figure), rows in chosen.groupby([CAPACITY, "agent", "figure"], sort=False):
        entry = {
            CAPACITY: float(str(size)), "agent": agent, "figure": figure, "unit": rows["unit"].iloc[0],
            "conventional": float(rows["conventional"].iloc[0]), "agents": spread(rows["agents"]),
            "leader": float(rows["leader"].iloc[0]),
        }  # fmt: skip
        if figure == "bill":
            entry["best_response"] = spread(rows["best_response"])
        found.append(entry)
    return found


def flat_from(table: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """From which size on the curves are flat, see ``FLAT``. [kWh]"""
    found = {}
    for figure in ("bill", "profit", "reserve_kwh"):
        rows = table[table["figure"] == figure].groupby([CAPACITY, "seed"])[["agents", "conventional", "leader"]].sum()
        rows = rows.reset_index()
        each = [flat(*_curve(one, "agents")) for _, one in rows.groupby("seed")]
        first = rows[rows["seed"] == rows["seed"].iloc[0]]
        # The curve that is drawn, in the middle of the seeds: a single seed's is never still.
        middle = rows.groupby(CAPACITY, as_index=False)[["agents"]].median()
        found[figure] = {
            "agents": {**spread(each), "median": flat(*_curve(middle, "agents"))},
            "leader": flat(*_curve(first, "leader")),
            "conventional": flat(*_curve(first, "conventional")),
        }  # fmt: skip
    return found


def _curve(rows: pd.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    return rows[CAPACITY].to_numpy(dtype=np.float64), rows[column].to_numpy(dtype=np.float64)


def flat(size: np.ndarray, value: np.ndarray) -> float:
    """The smallest size from which on the curve stays within ``FLAT`` of its whole change around its end."""
    near = np.abs(value - value[-1]) <= FLAT * max(float(np.ptp(value)), 1e-9)
    away = np.flatnonzero(~near)
    return float(size[0] if away.size == 0 else size[away[-1] + 1])


def policies(study: Study) -> list[dict[str, Any]]:
    """Where each seed's policies are: files to play them with."""
    return [
        {"seed": done.market.seed, **{part: str(done.folder / file) for part, file in done.policies.items()}}
        for done in study.paper.done()
    ]


def spread(values: ArrayLike) -> dict[str, float | None]:
    """Median, smallest and largest; None for what has no bound (a gap in per cent of a saving that is none)."""
    array = np.asarray(values, dtype=np.float64)
    found = {"median": np.median(array), "min": array.min(), "max": array.max()}
    return {name: float(value) if np.isfinite(value) else None for name, value in found.items()}
