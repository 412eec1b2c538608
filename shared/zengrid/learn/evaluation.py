"""How good policies are: on days that training never saw, beside the conventional rule and the best possible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.bounds import best_response
from zengrid.core.lattice import Lattice
from zengrid.core.leader import leader_reference, respond
from zengrid.core.levels import level_commands
from zengrid.core.settle import total
from zengrid.core.state import Exogenous, Settlement
from zengrid.env.facts import market_facts
from zengrid.env.vector import VectorMarket, slots_first
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import GridNetwork, ProsumerNetwork
from zengrid.policy.views import GridPolicy, ProsumerPolicy
from zengrid.scenario import Days, Scenario

Floats = NDArray[np.float64]

WEEK = 7
"""Days played in a row where stored energy is carried over from day to day."""

STABLE_GAP = 8.0
"""Up to this largest gap a market counts as settled. The aim is 10 %; on other days a gap may be larger. [%]"""

FEW_HOMES, FEW_STATES = 12, 128
"""Up to these, gaps are computed in every evaluation."""


class Outcome(NamedTuple):
    """What came of the days, as means over them."""

    bill: Floats
    """(home,) [$/day]"""
    profit: float
    """[$/day]"""
    reserve_kwh: float
    """energy of all facilities but the first [kWh/day]"""
    reserve_peak_kw: float
    """highest output of these facilities on a day [kW]"""
    self_consumption: Floats
    """(home,) share of the PV energy that is not exported or curtailed [-]"""
    curtailed_kwh: float
    """at the bus and at meters [kWh/day]"""
    unserved_kwh: float
    """at the bus and at meters [kWh/day]"""

    def against(self, other: Outcome) -> Changes:
        """How this differs from another outcome."""
        return Changes(
            100.0 * (self.bill - other.bill) / np.maximum(np.abs(other.bill), 1e-9),
            100.0 * (self.profit - other.profit) / max(abs(other.profit), 1e-9),
            100.0 * (self.reserve_kwh - other.reserve_kwh) / max(other.reserve_kwh, 1e-9),
        )


class Changes(NamedTuple):
    """Changes against another outcome. [%]"""

    bill: Floats
    profit: float
    reserve: float

    @property
    def joint_gain(self) -> float:
        """One number for all improvements (each bill, the profit, the reserve energy): their geometric mean. [%]

        It grows with the product of what everybody gains, by which Nash's bargaining solution weighs players: nobody's
        gain is given up for another's, and units do not matter. Where somebody loses, it is the worst loss.
        """
        gains = np.array([*(-self.bill), self.profit, -self.reserve])
        worst = float(gains.min())
        return worst if worst <= 0.0 else float(np.exp(np.log(gains).mean()))


PAPER = Changes(np.array([-38.0, -46.0, -26.0]), 37.0, -30.0)
"""What the paper reports for its case study. [%]"""


def reaches(changes: Changes, claim: Changes = PAPER) -> bool:
    """Whether every figure is as good as claimed."""
    return bool(
        np.all(changes.bill <= claim.bill) and changes.profit >= claim.profit and changes.reserve <= claim.reserve
    )


class Gap(NamedTuple):
    """What a prosumer would still gain by its best response, while all prices stay as they are."""

    dollars: Floats
    """(home,) [$/day]"""
    percent: Floats
    """(home,) of what it saves already against conventional [%]"""


class Rank(NamedTuple):
    """Of two results the larger is kept: that of a settled market before any other.

    A market is settled where nobody loses and no prosumer could gain more than ``STABLE_GAP`` by playing its best
    response. Among settled markets the grid's profit counts most: it leads, and followers that answer well to whatever
    it does are what it has to earn by (Stackelberg's equilibrium). It weighs four fifths in the geometric mean of all
    improvements, so that nobody's gain is given up for a per cent more of it. Among the others counts the joint gain,
    times the square of the least share that a prosumer takes of what it could save: high gains at prices that somebody
    has not yet found the answer to do not last.
    """

    settled: bool
    gain: float
    """[%]"""


class Trained(NamedTuple):
    """What the agents of one market play by."""

    grid: PolicyFile
    prosumers: PolicyFile


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What policies came to on some days."""

    agents: Outcome
    conventional: Outcome
    gap: Gap | None = None
    """Among the commands that the agents have."""
    gap_any_power: Gap | None = None
    """Among commands of any power."""

    @property
    def changes(self) -> Changes:
        """Against conventional. [%]"""
        return self.agents.against(self.conventional)

    @property
    def largest_gap(self) -> float | None:
        """Gap of the prosumer with most to gain still, among its own commands, of its saving; if it is known. [%]"""
        return None if self.gap is None else float(self.gap.percent.max())

    @property
    def rank(self) -> Rank:
        """By what policies are chosen."""
        gain, gap = self.changes.joint_gain, self.largest_gap
        if gap is None or gain <= 0.0:
            return Rank(False, gain)
        if gap <= STABLE_GAP:
            return Rank(True, self.changes.profit**0.75 * gain**0.25)
        return Rank(False, gain / (1.0 + gap / 100.0) ** 2)

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, for files."""
        return {
            "agents": plain(self.agents),
            "conventional": plain(self.conventional),
            "changes_percent": plain(self.changes),
            "gap": None if self.gap is None else plain(self.gap),
            "gap_any_power": None if self.gap_any_power is None else plain(self.gap_any_power),
        }


def plain(values: NamedTuple) -> dict[str, Any]:
    """Lists instead of arrays."""
    return {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values._asdict().items()}


class Leader(NamedTuple):
    """The leader reference on the days of an evaluation."""

    buy_price: Floats
    """(slot,) the schedule [$/kWh]"""
    outcome: Outcome
    """where every prosumer plays its best response to it, among the commands that agents have"""


class Played(NamedTuple):
    """Days played: every settlement with a leading axis ``(slot, chain)``, and the buy prices ``(slot, chain)``."""

    settled: Settlement
    buy_price: Floats


class Evaluator:
    """Days of a scenario on which policies are compared.

    Where stored energy is carried over, weeks are played from the initial state of charge; otherwise single days.

    Parameters
    ----------
    scenario:
        Market and days.
    numbers:
        Which days, increasing.
    """

    def __init__(self, scenario: Scenario, numbers: NDArray[np.int64]) -> None:
        self.scenario, self.market = scenario, scenario.market()
        in_a_row = min(WEEK, len(numbers)) if scenario.soc_reset == "never" else 1
        self.in_a_row, self.chains = in_a_row, len(numbers) // in_a_row
        self.numbers = numbers[: in_a_row * self.chains].reshape(self.chains, in_a_row)
        made = slots_first(Days(scenario).days(self.numbers.T.ravel()))
        # (slot, day in a row x chain, ...) -> (slot of the whole time, chain, ...)
        self.profile = Exogenous(
            *(
                np.ascontiguousarray(
                    np.swapaxes(column.reshape(len(column), in_a_row, self.chains, *column.shape[2:]), 0, 1)
                ).reshape(-1, self.chains, *column.shape[2:])
                for column in made
            )
        )
        self.slots = scenario.slots_per_day
        self._levels = level_commands(scenario.battery_levels, self.market.homes)
        # Few states to plan over: the best response among the agents' own commands takes milliseconds.
        self._quick = self.market.homes.count <= FEW_HOMES and (
            Lattice.closed(self.market, self._levels, self.market.homes.soc_initial, FEW_STATES) is not None
        )
        self.conventional_played = self.play(None, None)
        self.conventional = self.outcome(self.conventional_played.settled)

    @classmethod
    def held_out(cls, scenario: Scenario, days: int) -> Evaluator:
        """On days that training never sees."""
        return cls(scenario, Days(scenario).evaluation(days))

    @classmethod
    def for_choice(cls, scenario: Scenario, pool: int, days: int) -> Evaluator:
        """On days to choose policies by: behind those that training draws from, where there are more."""
        return cls(scenario, Days(scenario).training(pool + days)[pool:])

    def play(self, grid: GridPolicy | None, prosumers: ProsumerPolicy | None) -> Played:
        """Play all days; None stands for the conventional price and rule."""
        vector = VectorMarket(self.market, (self.chains,), np.array(self.scenario.buy_prices))
        settled, prices = [], []
        for day in range(self.in_a_row):
            part = slice(day * self.slots, (day + 1) * self.slots)
            soc = self.market.homes.soc_initial if day == 0 else None
            vector.begin(self.profile.part(part), soc, self.numbers[:, day])
            while not vector.over:
                price: Floats | float = self.scenario.baseline_buy_price
                if grid is not None:
                    price = grid.act(vector.grid_view())
                price = np.broadcast_to(np.asarray(price, dtype=np.float64), vector.lead)
                view = vector.prosumer_view(price)
                if prosumers is None:
                    command_kw = conventional(view.pv_kw, view.load_kw, self.market.homes)
                else:
                    command_kw = prosumers.act(view)
                settled.append(vector.step(price, command_kw))
                prices.append(price)
        return Played(Settlement(*map(np.stack, zip(*settled, strict=True))), np.stack(prices))

    def outcome(self, settled: Settlement) -> Outcome:
        """Means over the days."""
        dt_h, days = self.market.dt_h, self.in_a_row

        def daily(values: Floats) -> Floats:
            return np.asarray(values.sum(axis=0).mean(axis=0) / days)

        reserve_kw = total(settled.facility_kw[..., 1:])
        pv_kw = daily(self.profile.pv_kw)
        left_kw = daily(settled.home_export_kw + settled.home_curtailed_kw)
        peaks = reserve_kw.reshape(days, self.slots, self.chains).max(axis=1)
        return Outcome(
            bill=daily(settled.bill),
            profit=float(daily(settled.profit)),
            reserve_kwh=float(daily(reserve_kw)) * dt_h,
            reserve_peak_kw=float(peaks.mean()),
            self_consumption=np.where(pv_kw > 0.0, np.maximum(1.0 - left_kw / np.maximum(pv_kw, 1e-9), 0.0), 0.0),
            curtailed_kwh=float(daily(settled.curtailed_kw) + total(daily(settled.home_curtailed_kw))) * dt_h,
            unserved_kwh=float(daily(settled.unserved_kw) + total(daily(settled.home_unserved_kw))) * dt_h,
        )

    def evaluate(self, grid: GridPolicy | None, prosumers: ProsumerPolicy | None, gaps: bool = True) -> Evaluation:
        """What policies come to, and how far each prosumer is from its best response.

        Parameters
        ----------
        grid, prosumers:
            Policies; None stands for the conventional price and rule.
        gaps:
            Whether to compute best responses with any power, too, and those with the agents' own commands where that
            takes more than a moment. They know the days in advance, which no agent does.
        """
        played = self.play(grid, prosumers)
        agents = self.outcome(played.settled)
        own = self.gap(played, agents, self._levels) if gaps or self._quick else None
        return Evaluation(agents, self.conventional, own, self.gap(played, agents, None) if gaps else None)

    def gap(self, played: Played, agents: Outcome, commands_kw: Floats | None) -> Gap:
        """What the prosumers would gain by best-responding to the prices that were played."""
        day = self.profile
        best = best_response(
            self.market, day.pv_kw, day.load_kw, played.buy_price, day.sell_price, commands_kw=commands_kw
        )
        dollars = agents.bill - best.bill.mean(axis=0) / self.in_a_row
        saving = self.conventional.bill - agents.bill
        return Gap(dollars, np.where(saving > 1e-9, 100.0 * dollars / np.maximum(saving, 1e-9), np.inf))

    def evaluate_trained(self, trained: Trained, gaps: bool = True) -> Evaluation:
        """What the agents of a market come to."""
        facts = market_facts(self.scenario, self.scenario.home_ids)
        return self.evaluate(
            GridNetwork(trained.grid, market_facts(self.scenario)), ProsumerNetwork(trained.prosumers, facts), gaps
        )

    def leader(self, seed: int = 0, days: int = 4) -> Leader | None:
        """What a grid could earn that knows how prosumers answer, by a schedule found on the first few of the days.

        None where stored energy is carried over: there is no single day to search for.
        """
        if self.in_a_row > 1:
            return None
        few = Exogenous(*(np.ascontiguousarray(column[:, :days]) for column in self.profile))
        buy_price = leader_reference(
            self.market, few, np.array(self.scenario.buy_prices), np.random.default_rng(seed), commands_kw=self._levels
        ).buy_price
        prices = np.broadcast_to(buy_price[:, None], (self.slots, self.chains))
        return Leader(buy_price, self.outcome(respond(self.market, self.profile, prices, commands_kw=self._levels)))


def spread(values: Sequence[float]) -> tuple[float, float, float]:
    """Smallest, median and largest."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    return float(ordered[0]), float(np.median(ordered)), float(ordered[-1])
