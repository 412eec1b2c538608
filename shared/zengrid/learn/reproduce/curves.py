"""What happened on the way, and on one day: curves over training, and the day of the time-domain figure."""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.state import Exogenous
from zengrid.env.facts import market_facts
from zengrid.env.vector import pick
from zengrid.learn.evaluation import Evaluator
from zengrid.learn.reproduce.study import Study
from zengrid.learn.run import CHOICE_DAYS, PROGRESS
from zengrid.policy.network import GridNetwork, ProsumerNetwork

Floats = NDArray[np.float64]


class OverTraining(NamedTuple):
    """Curves over the episodes that each seed has lived through."""

    evaluated: Floats
    """(point,) episodes before an evaluation"""
    bill: Floats
    """(seed, point, home) of the agents as they were, on days for the choice [$/day]"""
    profit: Floats
    """(seed, point) [$/day]"""
    reserve_kwh: Floats
    """(seed, point) [kWh/day]"""
    conventional: tuple[Floats, float, float]
    """bills, profit and reserve energy on the same days without demand response"""
    episodes: Floats
    """(day,) episodes at the end of a day of training"""
    grid_reward: Floats
    """(seed, day) mean of the days played side by side, random actions included [$/day]"""
    prosumer_reward: Floats
    """(seed, day, home) [$/day]"""


def over_training(study: Study) -> OverTraining:
    """Read what trainings of the case study wrote down."""
    settings, slots = study.settings, study.scenario.slots_per_day
    bill, profit, reserve, grid, prosumer = [], [], [], [], []
    for done in study.paper.done():
        # A training that was killed between a report and its checkpoint has told of some days twice.
        lines = {}
        for text in (done.folder / PROGRESS).read_text(encoding="utf-8").splitlines():
            line = json.loads(text)
            lines[line["step"]] = line
        agents = [line["agents"][done.place] for line in lines.values()]
        bill.append([one["bill"] for one in agents])
        profit.append([one["profit"] for one in agents])
        reserve.append([one["reserve_kwh"] for one in agents])
        days = [day for line in lines.values() for day in line["earned"]]
        grid.append([day["profit"][done.place] for day in days])
        prosumer.append([[-paid for paid in day["bill"][done.place]] for day in days])
    before = Evaluator.for_choice(study.scenario, settings.pool, CHOICE_DAYS).conventional
    return OverTraining(
        np.array(list(lines)) * (settings.days / slots), np.array(bill), np.array(profit), np.array(reserve),
        (before.bill, before.profit, before.reserve_kwh),
        np.arange(1.0, len(grid[0]) + 1.0) * settings.days, np.array(grid), np.array(prosumer),
    )  # fmt: skip


class Day(NamedTuple):
    """The day without noise, slot by slot."""

    profile: Exogenous
    """(slot, ...)"""
    hours: Floats
    """(slot + 1,) [h]"""
    buy_price: Floats
    """(seed, slot) set by the trained grids [$/kWh]"""
    soc: Floats
    """(seed, slot + 1, home) [-]"""
    baseline_soc: Floats
    """(slot + 1, home) [-]"""
    seed: int
    """the one whose day is drawn: in the middle of all by the grid's profit on held-out days"""
    place: int
    """of that seed on the first axes"""


def one_day(study: Study) -> Day:
    """Play the case study's profiles as they are with the policies of every seed."""
    scenario = study.scenario.with_(noise="off")
    evaluator = Evaluator(scenario, np.array([0]))
    start = evaluator.market.homes.soc_initial[None]
    everything = study.paper.done()
    prices, socs = [], []
    for done in everything:
        paths = {part: done.folder / file for part, file in done.policies.items()}
        played = evaluator.play(
            GridNetwork.load(paths["grid"], market_facts(scenario)),
            ProsumerNetwork.load(paths["prosumers"], market_facts(scenario, scenario.home_ids)),
        )
        prices.append(played.buy_price[:, 0])
        socs.append(np.concatenate([start, played.settled.soc[:, 0]]))
    profits = np.array([done.evaluation["agents"]["profit"] for done in everything])
    place = int(np.argsort(profits)[(len(profits) - 1) // 2])
    return Day(
        pick(evaluator.profile, 0),
        np.arange(scenario.slots_per_day + 1.0) * scenario.dt_h, np.array(prices), np.array(socs),
        np.concatenate([start, evaluator.conventional_played.settled.soc[:, 0]]), everything[place].market.seed, place,
    )  # fmt: skip
