"""The market for PettingZoo, agent after agent: the grid sets the price, then each home sees it and acts."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray
from pettingzoo import AECEnv

from zengrid.env.episode import GRID, Episode

Floats = NDArray[np.float64]


class MarketAEC(AECEnv):
    """Leader, then followers, exactly as in the live market; a slot is settled when the last home has acted.

    Parameters
    ----------
    **options:
        Those of ``zengrid.env.episode.Episode``: ``scenario``, ``observation``, ``part``, ``days``, ``pool``.
    """

    metadata = {"name": "zengrid_market_v0", "render_modes": [], "is_parallelizable": False}  # noqa: RUF012 - theirs
    render_mode = None

    def __init__(self, **options: Any) -> None:
        super().__init__()
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

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        """Begin an episode; ``options={"day": 3}`` names its day instead of drawing one."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        self.episode.reset(self._rng, (options or {}).get("day"))
        self.agents = list(self.possible_agents)
        self.agent_selection = GRID
        self.rewards = dict.fromkeys(self.agents, 0.0)
        self._cumulative_rewards = dict.fromkeys(self.agents, 0.0)
        self.terminations = dict.fromkeys(self.agents, False)
        self.truncations = dict.fromkeys(self.agents, False)
        self.infos: dict[str, dict[str, Any]] = {agent: {} for agent in self.agents}
        self._commands = np.zeros(len(self.agents) - 1)

    def observe(self, agent: str) -> Floats:
        """What an agent sees now (paper eq. 14-15)."""
        return self.episode.see(agent)

    def step(self, action: int | None) -> None:
        """The agent whose turn it is acts."""
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            self._was_dead_step(action)
            return
        if action is None:
            raise ValueError(f"action = None: permitted for {agent}: 0 to {self.action_spaces[agent].n - 1}")
        self._cumulative_rewards[agent] = 0.0
        self._clear_rewards()
        place = self.agents.index(agent)
        if agent == GRID:
            self.episode.buy_price = float(self.episode.buy_prices[action])
        else:
            self._commands[place - 1] = self.episode.command(agent, action)
        if place + 1 == len(self.agents):
            self.rewards = self.episode.rewards(self.episode.step(self._commands.copy()))
            self.terminations = dict.fromkeys(self.agents, self.episode.terminated)
            self.truncations = dict.fromkeys(self.agents, self.episode.truncated)
        self.agent_selection = self.agents[(place + 1) % len(self.agents)]
        self._accumulate_rewards()

    def render(self) -> None:
        """Nothing: ``zengrid up`` shows a market."""

    def close(self) -> None:
        """Nothing to release."""
