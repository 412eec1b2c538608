"""One market, day after day, for agents outside of zengrid: whose turn it is, what they see, what they earn."""

from __future__ import annotations

from typing import Literal

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from zengrid.core.levels import level_commands
from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.core.state import Settlement
from zengrid.env.facts import market_facts
from zengrid.env.vector import VectorMarket
from zengrid.errors import ScenarioError
from zengrid.policy.facts import MarketFacts
from zengrid.scenario import Days, Scenario, load

Floats = NDArray[np.float64]
Part = Literal["training", "evaluation"]

GRID = "grid"

HIGHEST = {"soc": 1.0, "time_sin": 1.0, "time_cos": 1.0}
LOWEST = {"time_sin": -1.0, "time_cos": -1.0}
MOST = 1e9
"""Beyond all powers and payments; some learners refuse spaces without bounds."""


class Episode:
    """A market whose agents are the grid and every home, for episodes of whole days.

    Parameters
    ----------
    scenario:
        Scenario, or name of a built-in one.
    observation:
        What agents see: ``public`` or ``paper``.
    part:
        Which days are played: those for training or those for evaluation. ``reset`` draws one of them.
    days:
        Length of an episode. With ``soc_reset: daily`` an episode of one day ends there for good (terminated); in all
        other cases it is cut off (truncated), and what is stored is still worth something.
    pool:
        How many days there are to draw from.
    """

    def __init__(
        self,
        scenario: Scenario | str = "paper",
        observation: ObservationKind = "public",
        part: Part = "training",
        days: int = 1,
        pool: int = 1024,
    ) -> None:
        self.scenario = load(scenario) if isinstance(scenario, str) else scenario
        if GRID in self.scenario.home_ids:
            raise ScenarioError(f"homes: id {GRID!r} is that of the grid agent; permitted: any other")
        self.observation, self.length = observation, days
        self.market = self.scenario.market()
        self.agents = (GRID, *self.scenario.home_ids)
        self.buy_prices = np.array(self.scenario.buy_prices)
        self.commands_kw = level_commands(self.scenario.battery_levels, self.market.homes)
        self._place = {home: place for place, home in enumerate(self.scenario.home_ids)}
        self._days = Days(self.scenario)
        self._numbers = self._days.training(pool) if part == "training" else self._days.evaluation(pool)
        self.buy_price = self.scenario.baseline_buy_price

    def facts(self, agent: str) -> MarketFacts:
        """What a policy is told that plays this agent."""
        return market_facts(self.scenario, () if agent == GRID else (agent,))

    def features(self, agent: str) -> tuple[str, ...]:
        """Names of what an agent sees, in order."""
        if agent == GRID:
            return grid_features(self.observation, self.market.facilities.count, self.market.homes.count)
        return prosumer_features(self.observation)

    def observation_space(self, agent: str) -> Box:
        """Bounds of what an agent sees."""
        names = self.features(agent)
        high = {**HIGHEST, "buy_price": float(self.buy_prices[-1]), "sell_price": max(self.scenario.sell_prices)}
        high["buy_price"] = max(high["buy_price"], self.scenario.baseline_buy_price)
        return Box(
            np.array([LOWEST.get(name, 0.0) for name in names]),
            np.array([high.get(name, MOST) for name in names]),
            dtype=np.float64,
        )

    def action_space(self, agent: str) -> Discrete:
        """Price levels for the grid, battery levels (from discharging to charging) for a home."""
        return Discrete(len(self.buy_prices) if agent == GRID else len(self.commands_kw))

    def reset(self, rng: np.random.Generator, day: int | None = None) -> None:
        """Begin an episode on a day drawn at random, or on the given one."""
        self._day = int(rng.choice(self._numbers)) if day is None else day
        self.vector = VectorMarket(self.market, (), self.buy_prices)
        self._left = self.length
        self._begin(self.market.homes.soc_initial)
        self.buy_price = self.scenario.baseline_buy_price

    def _begin(self, soc: Floats | None) -> None:
        self.vector.begin(self._days.day(self._day), soc, self._day)

    def see(self, agent: str) -> Floats:
        """What an agent sees now; for homes under ``buy_price``."""
        if agent == GRID:
            return self.vector.grid_observation(self.observation)
        return self.vector.prosumer_observation(self.observation, self.buy_price)[self._place[agent]]

    def command(self, agent: str, action: int) -> float:
        """What a home's action stands for. [kW]"""
        return float(self.commands_kw[action, self._place[agent]])

    def step(self, battery_kw: Floats) -> Settlement:
        """Settle the slot under ``buy_price``, and go on into the next day where this one is over."""
        settled = self.vector.step(self.buy_price, battery_kw)
        if self.vector.over:
            self._left -= 1
            self._day += 1
            self._begin(self.market.homes.soc_initial if self.scenario.soc_reset == "daily" else None)
        return settled

    def rewards(self, settled: Settlement) -> dict[str, float]:
        """Profit for the grid, the negative bill for each home (paper eq. 16-17). [$]"""
        return {GRID: float(settled.profit), **{home: -float(settled.bill[i]) for home, i in self._place.items()}}

    @property
    def terminated(self) -> bool:
        """Whether the episode came to its natural end."""
        return self._left == 0 and self.length == 1 and self.scenario.soc_reset == "daily"

    @property
    def truncated(self) -> bool:
        """Whether the episode was cut off."""
        return self._left == 0 and not self.terminated
