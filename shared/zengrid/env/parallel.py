"""The market for PettingZoo, all at once: homes act in this slot while the grid sets the price of the next one."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from zengrid.env.episode import GRID, Episode

Floats = NDArray[np.float64]


class MarketParallel(ParallelEnv):
    """Every agent acts in every step.

    Homes have to see the price under which they act, and the grid is to act at the same time: so it posts its price one
    slot ahead. The first slot of an episode has the conventional price. Everything else is as in ``MarketAEC``, which
    is the live market's order of moves.

    Parameters
    ----------
    **options:
        Those of ``zengrid.env.episode.Episode``: ``scenario``, ``observation``, ``part``, ``days``, ``pool``.
    """

    metadata = {"name": "zengrid_market_v0", "render_modes": []}  # noqa: RUF012 - theirs
    render_mode = None

    def __init__(self, **options: Any) -> None:
        self.episode = Episode(**options)
        self.possible_agents = list(self.episode.agents)
        self.agents: list[str] = []
        self.observation_spaces = {agent: self.episode.observation_space(agent) for agent in self.possible_agents}
        self.action_spaces = {agent: self.episode.action_space(agent) for agent in self.possible_agents}
        self._rng = np.random.default_rng()

    def observation_space(self, agent: str) -> Box:
        """Always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """Always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Floats], dict[str, dict[str, Any]]]:
        """Begin an episode; ``options={"day": 3}`` names its day instead of drawing one."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.episode.reset(self._rng, (options or {}).get("day"))
        self.agents = list(self.possible_agents)
        return self._see(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, int]
    ) -> tuple[
        dict[str, Floats], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:  # fmt: skip
        """Settle a slot."""
        commands = [self.episode.command(home, actions[home]) for home in self.agents if home != GRID]
        rewards = self.episode.rewards(self.episode.step(np.array(commands)))
        self.episode.buy_price = float(self.episode.buy_prices[actions[GRID]])
        seen = self._see()
        terminated = dict.fromkeys(self.agents, self.episode.terminated)
        truncated = dict.fromkeys(self.agents, self.episode.truncated)
        infos: dict[str, dict[str, Any]] = {agent: {} for agent in self.agents}
        if self.episode.terminated or self.episode.truncated:
            self.agents = []
        return seen, rewards, terminated, truncated, infos

    def _see(self) -> dict[str, Floats]:
        return {agent: self.episode.see(agent) for agent in self.agents}

    def render(self) -> None:
        """Nothing: ``zengrid up`` shows a market."""

    def close(self) -> None:
        """Nothing to release."""
