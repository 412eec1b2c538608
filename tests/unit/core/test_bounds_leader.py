"""What the grid can reach against prosumers who answer best: the case study's table, and the search for a schedule."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.core.leader import Ties, leader_reference, respond, settle_day
from zengrid.core.levels import level_commands
from zengrid.core.state import Exogenous
from zengrid.scenario import Days, load

PAPER = load("paper").with_(noise="off")
MARKET, DAY = PAPER.market(), Days(PAPER).day(0)
LEVELS = np.array(PAPER.buy_prices)
HALF_KW = level_commands(9, MARKET.homes)
EVENING_SCHEDULE = np.array([0.05] * 18 + [0.09] + [0.10] * 3 + [0.08] + [0.05])


def test_the_conventional_day_of_the_case_study() -> None:
    settled = settle_day(MARKET, DAY, np.full(24, 0.05), None)
    assert np.round(settled.bill.sum(axis=0), 3).tolist() == [0.118, 0.330, 0.483]
    assert round(float(settled.profit.sum()), 2) == 10.21
    assert round(float(settled.facility_kw[:, 1].sum()), 1) == 22.6


def test_the_case_study_with_perfect_foresight() -> None:
    settled = respond(MARKET, DAY, EVENING_SCHEDULE, commands_kw=HALF_KW)
    assert np.round(settled.bill.sum(axis=0), 3).tolist() == [0.071, 0.150, 0.313]
    assert round(float(settled.profit.sum()), 2) == 14.39
    assert round(float(settled.facility_kw[:, 1].sum()), 1) == 11.6


@pytest.mark.parametrize("commands", [HALF_KW, None], ids=["levels", "any power"])
def test_ties_cost_prosumers_nothing_and_the_grid_much(commands: np.ndarray | None) -> None:
    ways: tuple[Ties, ...] = ("against_grid", "emptiest", "for_grid")
    answers = [respond(MARKET, DAY, EVENING_SCHEDULE, ties, commands) for ties in ways]
    profits = [float(answer.profit.sum()) for answer in answers]
    assert profits == sorted(profits)
    assert profits[2] - profits[0] > 0.5
    for answer in answers[1:]:
        np.testing.assert_allclose(answer.bill.sum(axis=0), answers[0].bill.sum(axis=0), rtol=0, atol=1e-6)


def test_the_search_repeats_for_a_seed_and_beats_every_constant_price() -> None:
    def search(day: Exogenous) -> tuple[list[float], float]:
        found = leader_reference(
            MARKET, day, LEVELS, np.random.default_rng(3), commands_kw=level_commands(5, MARKET.homes),
            restarts=1, neighbours=40, patience=2,
        )  # fmt: skip
        settled = respond(MARKET, DAY, found.buy_price, commands_kw=level_commands(5, MARKET.homes))
        assert found.profit == pytest.approx(float(settled.profit.sum()), abs=1e-9)
        assert found.reserve_kwh == pytest.approx(float(settled.facility_kw[:, 1].sum()), abs=1e-9)
        np.testing.assert_allclose(found.bill, settled.bill.sum(axis=0), rtol=0, atol=1e-9)
        return found.buy_price.tolist(), found.profit

    prices, profit = search(DAY)
    assert search(DAY) == (prices, profit)
    # The same day twice is no other market.
    twice = Exogenous(*(np.stack([field, field], axis=1) for field in DAY))
    assert search(twice)[0] == prices
    constants = [
        respond(MARKET, DAY, np.full(24, level), commands_kw=level_commands(5, MARKET.homes)) for level in LEVELS
    ]
    assert profit > max(float(settled.profit.sum()) for settled in constants)


@pytest.mark.slow
def test_the_search_finds_the_case_studys_schedule_or_a_better_one() -> None:
    found = leader_reference(MARKET, DAY, LEVELS, np.random.default_rng(0), commands_kw=HALF_KW)
    assert found.profit >= 14.39
    assert np.all(found.bill < [0.118, 0.330, 0.483])
    assert found.reserve_kwh < 12.0
