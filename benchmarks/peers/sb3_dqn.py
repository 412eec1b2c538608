"""Throughput of Stable-Baselines3's DQN on one home of the scenario ``paper``, one thread, networks of 64x64.

    python benchmarks/peers/sb3_dqn.py

Needs ``pip install -r benchmarks/peers/requirements.txt``. Prints agent steps and gradient updates per CPU-second.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import stable_baselines3
from stable_baselines3 import DQN
from stable_baselines3.common.env_util import make_vec_env

from dqn_results import Configuration, CpuTimer, Timed, run_peer
from home_env import HomeEnv

WARM_UP_STEPS = 300


def train(steps: int, environments: int = 1, **settings: Any) -> Timed:
    """One training on so many environments side by side."""
    model = DQN(
        "MlpPolicy",
        make_vec_env(HomeEnv, n_envs=environments),
        policy_kwargs={"net_arch": [64, 64]},
        learning_starts=100,
        device="cpu",
        seed=0,
        **settings,
    )
    model.learn(WARM_UP_STEPS)
    steps_before, updates_before, timer = model.num_timesteps, model._n_updates, CpuTimer()
    model.learn(steps, reset_num_timesteps=False)
    return timer.stop(model.num_timesteps - steps_before, model._n_updates - updates_before)


CONFIGURATIONS: list[Configuration] = [
    ("default", 32, train),
    ("default but the batch", 256, partial(train, batch_size=256)),
    ("an update every step", 32, partial(train, train_freq=1)),
    ("8 environments", 32, partial(train, environments=8)),
]

if __name__ == "__main__":
    run_peer(__doc__, __file__, f"Stable-Baselines3 {stable_baselines3.__version__}", CONFIGURATIONS)
