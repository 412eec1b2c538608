"""The two kinds of agents that learn in a running market, in the terms of policies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from zengrid.core.levels import to_commands
from zengrid.core.observe import ObservationKind
from zengrid.learn.dqn import DQN, Stack
from zengrid.learn.live import Learner, Moment
from zengrid.learn.live_settings import Live
from zengrid.learn.settings import Learning
from zengrid.policy.facts import MarketFacts
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import grid_observation, prosumer_observation
from zengrid.policy.views import GridView, ProsumerView

Floats = NDArray[np.float64]


def warm_up() -> None:
    """Let torch load what it loads at its first update, before a market waits."""
    learning = Learning(hidden=(8,), batch=4, memory=8)
    learners = DQN(Stack(1, 1, 2, 2), learning, torch.Generator().manual_seed(0))
    for _ in range(6):
        learners.replay.add(
            torch.zeros((1, 1, 2)), torch.zeros((1, 1), dtype=torch.int64), torch.zeros((1, 1)), 0.0, True
        )
    learners.learn(0.0)


class ProsumerLearner(Learner):
    """Commands the batteries of an agent's homes, and learns from what comes of it."""

    def __init__(
        self, agent: str, facts: MarketFacts, live: Live, kind: ObservationKind = "public",
        start: PolicyFile | None = None,
    ) -> None:  # fmt: skip
        super().__init__("prosumer", agent, facts, live, kind, start)

    def act(self, view: ProsumerView) -> Floats | None:
        """Commands ``(home,)`` [kW]; None where it still watches."""
        assert isinstance(view.day, int)
        observation = prosumer_observation(self.kind, view)
        level = self.choose(Moment(view.day, view.slot), observation, float(view.sell_price))
        return None if level is None else to_commands(self.levels[level], view.homes)

    def hear(self, day: int, slot: int, reward: Sequence[float] | Floats, fallback: bool) -> None:
        """What came of a slot: rewards ``(home,)`` [$], and whether another has decided."""
        level = None if fallback or self._seen is None else self._seen.level
        self._settled(Moment(day, slot), level, np.asarray(reward, dtype=np.float64))


class GridLearner(Learner):
    """Sets the buy price, and learns from what comes of it."""

    def __init__(
        self, facts: MarketFacts, live: Live, kind: ObservationKind = "public", start: PolicyFile | None = None
    ) -> None:
        super().__init__("grid", "grid", facts, live, kind, start)

    def act(self, view: GridView) -> float | None:
        """The price [$/kWh]; None where it still watches."""
        assert isinstance(view.day, int)
        observation = grid_observation(self.kind, view)[None]
        level = self.choose(Moment(view.day, view.slot), observation, float(view.sell_price))
        return None if level is None else float(self.levels[level[0]])

    def hear(self, day: int, slot: int, reward: float, buy_price: float) -> None:
        """What came of a slot: the profit [$], and the price that really held [$/kWh]."""
        level = np.array([np.abs(self.levels - buy_price).argmin()])
        self._settled(Moment(day, slot), level, np.array([reward]))
