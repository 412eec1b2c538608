"""Results of an evaluation as files: JSON and CSV."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from zengrid.learn.evaluation import Evaluation, Evaluator, Leader, plain
from zengrid.scenario import Scenario


def as_dict(
    scenario: Scenario, evaluator: Evaluator, found: dict[str, Evaluation], leader: Leader | None
) -> dict[str, Any]:
    """All results as plain values for JSON."""
    return {
        "scenario": scenario.name,
        "homes": list(scenario.home_ids),
        "days": evaluator.numbers.ravel().tolist(),
        "soc_reset": scenario.soc_reset,
        "markets": {name: evaluation.as_dict() for name, evaluation in found.items()},
        "leader_reference": None
        if leader is None
        else {"buy_price": leader.buy_price.tolist(), "outcome": plain(leader.outcome)},
    }


def write_csv(path: Path, scenario: Scenario, found: dict[str, Evaluation]) -> None:
    """One row for each market and agent."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["market", "agent", "figure", "baseline", "agents", "change_percent", "gap", "gap_percent"])
        for name, e in found.items():
            for place, home in enumerate(scenario.home_ids):
                gap = (
                    [] if e.gap_any_power is None else [e.gap_any_power.dollars[place], e.gap_any_power.percent[place]]
                )
                numbers = [e.conventional.bill[place], e.agents.bill[place], e.changes.bill[place], *gap]
                table.writerow([name, home, "bill", *map(float, numbers)])
            table.writerow([name, "grid", "profit", e.conventional.profit, e.agents.profit, e.changes.profit])
            reserve = (e.conventional.reserve_kwh, e.agents.reserve_kwh, e.changes.reserve)
            table.writerow([name, "grid", "reserve_kwh", *reserve])
