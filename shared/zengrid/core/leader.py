"""How well the grid can do at best: a search for the price schedule to which best-responding prosumers answer best."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.bounds import best_response
from zengrid.core.dispatch import dispatch, facility_cost
from zengrid.core.params import MarketParams
from zengrid.core.settle import settle, total
from zengrid.core.state import Action, Exogenous, Settlement

Floats = NDArray[np.float64]
Ties = Literal["emptiest", "for_grid", "against_grid"]

TIE_PRICE = 1e-8
"""Share of the grid's marginal cost that is added to prices to break prosumers' ties. [-]"""

ENOUGH = 1e-7
"""Smallest gain in profit for which a search continues. [$]"""


class LeaderReference(NamedTuple):
    """The best schedule found and its outcome; money and energy are means over the days.

    buy_price: ``(slot,)`` [$/kWh]
    profit: of the grid [$/day]
    bill: ``(home,)`` [$/day]
    reserve_kwh: from all facilities but the first [kWh/day]
    schedules: number of schedules tried
    """

    buy_price: Floats
    profit: float
    bill: Floats
    reserve_kwh: float
    schedules: int


def settle_day(
    market: MarketParams, day: Exogenous, buy_price: Floats, command_kw: Floats | None, soc: Floats | None = None
) -> Settlement:
    """Settle slot after slot; every field of the result has a leading axis ``(slot,)``.

    Parameters
    ----------
    day:
        Each field with a leading axis ``(slot,)``.
    buy_price:
        ``(slot, ...)``. [$/kWh]
    command_kw:
        ``(slot, ..., home)``; None applies the conventional rule. [kW]
    soc:
        State of charge at the start, ``(..., home)``; None: the homes' initial one. [-]
    """
    state = market.homes.soc_initial if soc is None else soc
    settled = []
    for slot in range(len(buy_price)):
        now = day.slot(slot)
        command = conventional(now.pv_kw, now.load_kw, market.homes) if command_kw is None else command_kw[slot]
        settled.append(settle(state, Action(buy_price[slot], command), now, market))
        state = settled[-1].soc
    return Settlement(*(np.stack(column) for column in zip(*settled, strict=True)))


def respond(
    market: MarketParams,
    day: Exogenous,
    buy_price: Floats,
    ties: Ties = "emptiest",
    commands_kw: Floats | None = None,
    soc: Floats | None = None,
) -> Settlement:
    """Settle the day on which every prosumer plays its best response to a schedule.

    Prosumers often have many equally cheap days: they can buy and sell at one price, or charge sooner or later from the
    same surplus. The grid's profit may differ by more than a dollar between them. ``ties`` chooses one:

    ``emptiest``
        the battery holds the least energy: it discharges as early and charges as late as possible at no cost. This
        depends on the prosumers' own bills alone. The figures of the case study use it.
    ``for_grid``, ``against_grid``
        the optimistic and the pessimistic response: homes export where the grid's marginal cost (on the conventional
        day) is highest, or lowest. Both are linear in that cost, so neither is a strict bound over all ties.
    """
    if ties == "emptiest":
        answer = best_response(market, day.pv_kw, day.load_kw, buy_price, day.sell_price, soc, commands_kw=commands_kw)
        return settle_day(market, day, buy_price, answer.battery_kw, soc)
    sign = TIE_PRICE if ties == "for_grid" else -TIE_PRICE
    start = market.homes.soc_initial if soc is None else soc
    settled = settle_day(market, day, buy_price, None, soc)
    lead = np.broadcast_shapes(buy_price.shape, settled.profit.shape)
    command_kw = np.broadcast_to(settled.battery_kw, (*lead, market.homes.count)).copy()
    for home in range(market.homes.count):
        one = slice(home, home + 1)
        alone = market.with_homes(market.homes.take([home]))
        # The grid's saving for each kWh if this home discharges at full power instead of idling.
        idle_kw = total(day.consumer_kw) - total(settled.injection_kw) - settled.battery_kw[..., home]
        full_kw = max(float(market.homes.discharge_max_kw[home]), TIE_PRICE)
        saved = (_cost(market, idle_kw) - _cost(market, idle_kw - full_kw)) / (full_kw * market.dt_h) * sign
        command_kw[..., one] = best_response(
            alone, day.pv_kw[..., one], day.load_kw[..., one], buy_price + saved, day.sell_price + saved,
            start[..., one], commands_kw=None if commands_kw is None else commands_kw[:, one], hold_price=0.0,
        ).battery_kw  # fmt: skip
        settled = settle_day(market, day, buy_price, command_kw, soc)
    return settled


def leader_reference(
    market: MarketParams,
    day: Exogenous,
    levels: Floats,
    rng: np.random.Generator,
    ties: Ties = "emptiest",
    commands_kw: Floats | None = None,
    restarts: int = 3,
    neighbours: int = 512,
    patience: int = 3,
) -> LeaderReference:
    """Search the most profitable price schedule against prosumers who play their best response.

    The grid can reach this reference, but it is no upper bound: finding the best schedule is a bilevel program. The
    search starts from the best constant price, then from random schedules. In each round it moves to the best of many
    neighbours, in which one interval of the day has another price, until ``patience`` rounds in a row find none better.

    Parameters
    ----------
    day:
        Each field with leading axis ``(slot,)``, or ``(slot, day)`` for one schedule that serves several days at once.
    levels:
        Prices that the grid may set, ``(level,)``. [$/kWh]
    rng:
        Draws neighbours and the schedules from which to restart.
    commands_kw:
        The only commands of prosumers, ``(level, home)``; None allows any power and takes longer. [kW]
    restarts:
        Number of searches.
    neighbours:
        Schedules tried in each round. A day of 24 slots and six levels has about 1,500 neighbours.
    patience:
        Rounds without a gain after which a search ends.
    """
    trials = _Trials(market, day, ties, commands_kw)
    best, best_profit = np.full(trials.slots, levels[0]), -np.inf
    for search in range(restarts):
        constant = np.repeat(levels[:, None], trials.slots, axis=1)
        starts = constant if search == 0 else _random_schedules(trials.slots, levels, rng)
        found, profit = _climb(trials, starts, levels, neighbours, patience, rng)
        if profit > best_profit:
            best, best_profit = found, profit
    settled = trials.settle(best[None])
    over = tuple(range(1, settled.profit.ndim))
    reserve_kw = total(settled.facility_kw[..., 1:])
    return LeaderReference(
        buy_price=best,
        profit=float(settled.profit.mean(axis=over).sum()),
        bill=settled.bill.mean(axis=over).sum(axis=0),
        reserve_kwh=float(reserve_kw.mean(axis=over).sum()) * market.dt_h,
        schedules=trials.tried,
    )


class _Trials:
    """Settles the day, or the days, for candidate schedules ``(candidate, slot)`` and counts them."""

    def __init__(self, market: MarketParams, day: Exogenous, ties: Ties, commands_kw: Floats | None) -> None:
        self.slots = len(day.sell_price)
        self.tried = 0
        self._several = day.sell_price.ndim > 1
        # Leading axes: candidate, and day where there are several.
        self._day = day.part((slice(None), None))
        self._market, self._ties, self._commands_kw = market, ties, commands_kw

    def settle(self, candidates: Floats) -> Settlement:
        """Every prosumer plays its best response, ``(slot, candidate, ...)``."""
        prices = candidates.T[..., None] if self._several else candidates.T
        return respond(self._market, self._day, prices, self._ties, self._commands_kw)

    def profits(self, candidates: Floats) -> Floats:
        """The grid's profit with each candidate, ``(candidate,)``, as mean over the days. [$/day]"""
        self.tried += len(candidates)
        profit: Floats = self.settle(candidates).profit.sum(axis=0)
        return np.mean(profit, axis=1) if self._several else profit


def _climb(
    trials: _Trials, starts: Floats, levels: Floats, neighbours: int, patience: int, rng: np.random.Generator
) -> tuple[Floats, float]:
    """Go from the best start to better neighbours until ``patience`` rounds find none; returns schedule and profit."""
    gains = trials.profits(starts)
    here, profit = starts[np.argmax(gains)], float(gains.max())
    rounds = 0
    while rounds < patience:
        around = _neighbours(here, levels, neighbours, rng)
        gains = trials.profits(around)
        rounds += 1
        if gains.max() > profit + ENOUGH:
            here, profit, rounds = around[np.argmax(gains)], float(gains.max()), 0
    return here, profit


def _neighbours(schedule: Floats, levels: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Schedules in which one interval has another price, ``(candidate, slot)``."""
    slots = schedule.size
    first, last = np.triu_indices(slots)
    every = first.size * levels.size
    picked = np.arange(every) if every <= count else rng.choice(every, count, replace=False)
    interval, level = np.divmod(picked, levels.size)
    now = np.arange(slots)
    inside = (now >= first[interval, None]) & (now <= last[interval, None])
    return np.where(inside, levels[level, None], schedule)


def _random_schedules(slots: int, levels: Floats, rng: np.random.Generator, count: int = 32) -> Floats:
    """Schedules of a few intervals with random prices, ``(candidate, slot)``."""
    schedules = np.repeat(rng.choice(levels, (count, 1)), slots, axis=1)
    now = np.arange(slots)
    for _ in range(4):
        ends = np.sort(rng.integers(0, slots + 1, (count, 2)), axis=1)
        inside = (now >= ends[:, :1]) & (now < ends[:, 1:])
        schedules = np.where(inside, rng.choice(levels, (count, 1)), schedules)
    return schedules


def _cost(market: MarketParams, net_kw: Floats) -> Floats:
    """What the facilities cost over a slot at a net demand, ``(...)``. [$]"""
    return total(facility_cost(dispatch(net_kw, market)[0], market))
