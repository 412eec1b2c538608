"""The built-in scenarios without demand response: the case study's published numbers, and sensible large markets."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.scenario import Days, Scenario, load


def play(scenario: Scenario) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Bills, profit and energies of a day under the conventional rule and price."""
    market, day = scenario.market(), Days(scenario.with_(noise="off")).day(0)
    soc, slots = market.homes.soc_initial, []
    for slot in range(scenario.slots_per_day):
        now = day.slot(slot)
        command = conventional(now.pv_kw, now.load_kw, market.homes)
        slots.append(settle(soc, Action(np.array(scenario.baseline_buy_price), command), now, market))
        soc = slots[-1].soc
    energies = {
        name: np.sum([getattr(s, name) for s in slots], axis=0) * scenario.dt_h
        for name in ("facility_kw", "curtailed_kw", "unserved_kw", "export_kw", "demand_kw")
    }
    return energies | {name: np.sum([getattr(s, name) for s in slots], axis=0) for name in ("bill", "profit")}


def test_paper_gives_the_case_studys_conventional_day(paper: Scenario) -> None:
    day = play(paper)
    assert day["bill"].round(3).tolist() == [0.118, 0.330, 0.483]
    assert float(day["profit"]) == pytest.approx(10.21, abs=0.01)
    assert day["facility_kw"][1] == pytest.approx(22.6, abs=0.05)


def test_paper_agrees_across_slot_lengths(paper: Scenario) -> None:
    hour, quarter = play(paper), play(paper.with_(slot_minutes=15))
    np.testing.assert_allclose(quarter["demand_kw"], hour["demand_kw"], rtol=0.02)
    np.testing.assert_allclose(quarter["bill"], hour["bill"], rtol=0.1)
    np.testing.assert_allclose(quarter["profit"], hour["profit"], rtol=0.03)


@pytest.mark.parametrize("name", ["village", "city"])
def test_large_markets_are_the_papers_kind_of_market(name: str) -> None:
    day = play(load(name))
    assert float(day["curtailed_kw"]) == 0.0
    assert float(day["unserved_kw"]) == 0.0
    assert float(day["profit"]) > 0.0
    assert 0.03 < day["facility_kw"][1] / day["facility_kw"].sum() < 0.15
    assert day["export_kw"].sum() / day["demand_kw"] > 0.02
    assert day["bill"].mean() > 0.0
