"""The market for Gymnasium: one agent learns, given policies play the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from zengrid.env.episode import GRID, Episode
from zengrid.errors import ScenarioError
from zengrid.policy.registry import make_grid_policy, make_prosumer_policy

Floats = NDArray[np.float64]


class MarketEnv(gymnasium.Env):
    """One home, or the grid, in a market of policies.

    Parameters
    ----------
    agent:
        Who learns: ``grid`` or the id of a home.
    policies:
        Who plays the others, by agent, as ``zengrid up --policy`` takes it: ``{"grid": "tou:0.05,18:00=0.09"}``. Who is
        not named plays ``conventional``; the grid ``fixed``.
    **options:
        Those of ``zengrid.env.episode.Episode``: ``scenario``, ``observation``, ``part``, ``days``, ``pool``.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - theirs
    render_mode = None

    def __init__(self, agent: str = "p1", policies: Mapping[str, str] | None = None, **options: Any) -> None:
        self.episode = episode = Episode(**options)
        policies = policies or {}
        for name in (agent, *policies):
            if name not in episode.agents:
                raise ScenarioError(f"agent = {name}: permitted: {', '.join(episode.agents)}")
        self.agent = agent
        self.observation_space = episode.observation_space(agent)
        self.action_space = episode.action_space(agent)
        self._grid = make_grid_policy(policies.get(GRID, "fixed"), episode.facts(GRID))
        homes = episode.agents[1:]
        self._others = [make_prosumer_policy(policies.get(home, "conventional"), episode.facts(home)) for home in homes]
        self._place = None if agent == GRID else homes.index(agent)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; ``options={"day": 3}`` names its day instead of drawing one."""
        super().reset(seed=seed)
        self.episode.reset(self.np_random, (options or {}).get("day"))
        return self._see(), {}

    def step(self, action: int) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Settle a slot."""
        episode = self.episode
        if self._place is None:
            episode.buy_price = float(episode.buy_prices[action])
        commands = np.empty(len(self._others))
        for place, policy in enumerate(self._others):
            if place == self._place:
                commands[place] = episode.command(self.agent, action)
            else:
                view = episode.vector.prosumer_view(episode.buy_price, slice(place, place + 1))
                commands[place] = policy.act(view)[0]
        reward = episode.rewards(episode.step(commands))[self.agent]
        return self._see(), reward, episode.terminated, episode.truncated, {}

    def _see(self) -> Floats:
        """What the learner sees; a home, once the grid has set the price."""
        if self._place is not None:
            self.episode.buy_price = float(self._grid.act(self.episode.vector.grid_view()))
        return self.episode.see(self.agent)
