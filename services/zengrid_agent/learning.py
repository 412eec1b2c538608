"""Agents that learn while they play: a learner that saves what it has learned."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import TYPE_CHECKING, cast

from zengrid.learn.require_torch import load_learning_agents
from zengrid.policy import trained
from zengrid.policy.file import PolicyFile
from zengrid.policy.registry import SUFFIX

if TYPE_CHECKING:
    from zengrid.core.observe import ObservationKind
    from zengrid.learn.live import Learner
    from zengrid.learn.live_agents import GridLearner, ProsumerLearner
    from zengrid.learn.live_settings import Live
    from zengrid.policy.facts import MarketFacts
    from zengrid.policy.file import Role

CHECKPOINT = ".checkpoint"
"""Of files from which a learner goes on."""
SAVE_S = 10.0
"""How often it is written down what was learned. [s]"""


class Learning:
    """What an agent with ``--learn`` has beside its policy.

    Parameters
    ----------
    options:
        The command line.
    agent, role:
        Who learns.
    """

    def __init__(self, options: argparse.Namespace, agent: str, role: Role) -> None:
        self._agent, self._role = agent, role
        self._kind: ObservationKind = options.observation
        self._changes = {"slots": options.explore, "seed": options.learn_seed}
        folder = options.learned or Path("runs") / options.run / "learned"
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"{agent}{CHECKPOINT}"
        self._saved = time.monotonic()
        self._learner: Learner | None = None
        load_learning_agents()
        # Only in the process that learns: what gradients are computed with does not survive a fork.
        from zengrid.learn.live_agents import warm_up

        warm_up()

    def begin(self, facts: MarketFacts, policy: str) -> str:
        """Make the learner for a market; returns what to tell about where it starts from.

        Raises
        ------
        PolicyError
            Where what was learned before, or the policy to start from, does not fit the market.
        """
        from zengrid.learn.live_agents import GridLearner, ProsumerLearner
        from zengrid.learn.live_settings import Live

        live: Live = Live.of(self._role, **self._changes)
        goes_on = self.path.exists()
        start = None if goes_on else self._start(facts, policy)
        learner: Learner
        if self._role == "grid":
            learner = GridLearner(facts, live, self._kind, start)
        else:
            learner = ProsumerLearner(self._agent, facts, live, self._kind, start)
        if goes_on:
            learner.restore(self.path)
        self._learner = learner
        if goes_on:
            return f"{self._agent} goes on learning after {learner.slots} slots, from {self.path}"
        return f"{self._agent} learns, starting from {policy if start else 'nothing'}; it is kept in {self.path}"

    def _start(self, facts: MarketFacts, policy: str) -> PolicyFile | None:
        """The network to start from, where the policy is one."""
        if policy.endswith(SUFFIX):
            return PolicyFile.load(policy)
        if policy == "generic":
            return trained.load(trained.GENERIC)
        if policy == "trained":
            return (trained.for_grid(facts) if self._role == "grid" else trained.for_prosumer(facts)).file
        return None

    @property
    def grid(self) -> GridLearner:
        """The learner of a grid agent."""
        return cast("GridLearner", self._learner)

    @property
    def prosumer(self) -> ProsumerLearner:
        """The learner of a prosumer agent."""
        return cast("ProsumerLearner", self._learner)

    def reflect(self) -> None:
        """Learn from what came, and write it down now and then."""
        assert self._learner is not None
        self._learner.learn()
        if time.monotonic() - self._saved >= SAVE_S:
            self.save()

    def save(self) -> None:
        """Write down what was learned."""
        if self._learner is not None:
            self._learner.save(self.path)
            self._saved = time.monotonic()
