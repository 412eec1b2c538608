"""Throughput of a single-file DQN in the style of CleanRL on one home of the scenario ``paper``, one thread.

    python benchmarks/peers/cleanrl_dqn.py

CleanRL is a collection of scripts to copy, not a package; this one is written anew from the published algorithm (Mnih
et al., 2015, doi:10.1038/nature14236) with CleanRL's defaults: one environment, an update every 10 steps, batches of
128, Adam at 2.5e-4, a target network copied every 500 steps. Networks of 64x64. Prints agent steps and gradient updates
per CPU-second.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from dqn_results import Configuration, CpuTimer, Timed, run_peer
from home_env import HomeEnv

CAPACITY = 10_000
DISCOUNT = 0.99
LEARNING_RATE = 2.5e-4
TARGET_EVERY = 500
WARM_UP_STEPS = 300
LAST_EXPLORATION = 0.05


class Replay:
    """The last transitions, in preallocated arrays."""

    def __init__(self, features: int) -> None:
        self.seen, self.next_seen = np.zeros((2, CAPACITY, features), np.float32)
        self.actions = np.zeros(CAPACITY, np.int64)
        self.rewards, self.ended = np.zeros((2, CAPACITY), np.float32)
        self.count = 0

    def add(self, seen: np.ndarray, action: int, reward: float, next_seen: np.ndarray, ended: bool) -> None:  # type: ignore[type-arg]
        """Keep a transition; the oldest one goes."""
        place = self.count % CAPACITY
        self.seen[place], self.next_seen[place] = seen, next_seen
        self.actions[place], self.rewards[place], self.ended[place] = action, reward, ended
        self.count += 1

    def sample(self, rng: np.random.Generator, batch: int) -> list[Tensor]:
        """Transitions at random."""
        index = rng.integers(0, min(self.count, CAPACITY), batch)
        columns = (self.seen, self.actions, self.rewards, self.next_seen, self.ended)
        return [torch.from_numpy(column[index]) for column in columns]


def make_network(features: int, actions: int) -> nn.Sequential:
    """Values of all actions."""
    return nn.Sequential(nn.Linear(features, 64), nn.ReLU(), nn.Linear(64, 64), nn.ReLU(), nn.Linear(64, actions))


def train(steps: int, every: int, batch: int) -> Timed:
    """One training with an update every so many steps."""
    torch.manual_seed(0)
    rng, env = np.random.default_rng(0), HomeEnv()
    actions = len(env.commands_kw)
    network, target = make_network(4, actions), make_network(4, actions)
    target.load_state_dict(network.state_dict())
    optimiser = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    replay, updates, timer = Replay(4), 0, CpuTimer()
    seen, _ = env.reset(seed=0)
    for step in range(WARM_UP_STEPS + steps):
        if step == WARM_UP_STEPS:
            updates, timer = 0, CpuTimer()
        if rng.random() < max(LAST_EXPLORATION, 1.0 - 2.0 * step / steps):
            action = int(rng.integers(actions))
        else:
            with torch.no_grad():
                action = int(network(torch.from_numpy(seen)[None]).argmax())
        next_seen, reward, ended, truncated, _ = env.step(action)
        replay.add(seen, action, reward, next_seen, ended)
        seen = env.reset()[0] if ended or truncated else next_seen
        if step >= WARM_UP_STEPS and step % every == 0:
            update(network, target, optimiser, replay.sample(rng, batch))
            updates += 1
        if step % TARGET_EVERY == 0:
            target.load_state_dict(network.state_dict())
    return timer.stop(steps, updates)


def update(network: nn.Module, target: nn.Module, optimiser: torch.optim.Optimizer, transitions: list[Tensor]) -> None:
    """One gradient step towards the Bellman target."""
    seen, action, reward, next_seen, ended = transitions
    with torch.no_grad():
        aim = reward + DISCOUNT * target(next_seen).max(dim=1).values * (1.0 - ended)
    loss = nn.functional.mse_loss(network(seen).gather(1, action[:, None]).squeeze(1), aim)
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimiser.step()


CONFIGURATIONS: list[Configuration] = [
    ("default", 128, partial(train, every=10, batch=128)),
    ("an update every fourth step", 32, partial(train, every=4, batch=32)),
    ("an update every step", 32, partial(train, every=1, batch=32)),
    ("an update every step", 64, partial(train, every=1, batch=64)),
]

if __name__ == "__main__":
    run_peer(__doc__, __file__, "CleanRL's way", CONFIGURATIONS)
