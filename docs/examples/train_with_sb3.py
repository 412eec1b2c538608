"""Train a home with Stable-Baselines3 against a price schedule, compare it with the best possible, and save it.

python train_with_sb3.py            # 20,000 slots, about half a minute
python train_with_sb3.py 100000     # another number of slots
"""

import sys

import numpy as np
from gymnasium.wrappers import TransformObservation, TransformReward
from stable_baselines3 import DQN

from zengrid.core.bounds import best_response
from zengrid.core.levels import level_commands, level_fractions
from zengrid.env.single import MarketEnv
from zengrid.policy.file import Layer, PolicyFile
from zengrid.scenario import Days

slots = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
home, prices = "p2", "tou:0.05,18:00=0.09,19:00=0.10,22:00=0.08,23:00=0.05"
# Scales SoC, PV, consumption, buy price, sine and cosine of the time of day, and sell price to about -1..1.
offset = np.array([0.5, 1.5, 1.0, 0.075, 0.0, 0.0, 0.0725])
scale = np.array([2.0, 0.7, 1.0, 40.0, 1.0, 1.0, 40.0])


def market(part):
    """Return the home among conventional neighbours, on training or evaluation days."""
    return MarketEnv(home, {"grid": prices}, part=part)


def scaled(env):
    """Scale observations and rewards to about one for the learner."""
    env = TransformObservation(env, lambda seen: ((seen - offset) * scale).astype(np.float32), env.observation_space)
    return TransformReward(env, lambda reward: 5.0 * reward)


def play(choose, days=32):
    """Return the mean bill over days that training never sees. [$/day]"""
    env, bills = market("evaluation"), []
    for day in range(days):
        seen, _ = env.reset(options={"day": day})
        bill, over = 0.0, False
        while not over:
            seen, reward, over, _, _ = env.step(choose(env, seen))
            bill -= reward
        bills.append(bill)
    return float(np.mean(bills))


def conventional(env, seen):
    """Return the level nearest to the home's surplus; a deficit discharges the battery."""
    levels = env.episode.commands_kw[:, env.episode.agents.index(home) - 1]
    return int(np.argmin(np.abs(levels - (seen[1] - seen[2]))))


learner = DQN(
    "MlpPolicy", scaled(market("training")), learning_rate=1e-3, learning_starts=500, train_freq=4, gamma=0.995,
    target_update_interval=500, exploration_fraction=0.6, batch_size=128, seed=0, device="cpu",
)  # fmt: skip
learner.learn(slots)

learned = play(lambda env, seen: int(learner.predict((seen - offset) * scale, deterministic=True)[0]))
rule = play(conventional)

# The best result that these commands could reach if they knew every day in advance.
episode = market("evaluation").episode
place = episode.agents.index(home) - 1
days = Days(episode.scenario).days(range(32))
one = episode.market.with_homes(episode.market.homes.take([place]))
pv_kw, load_kw = (np.swapaxes(column[..., [place]], 0, 1) for column in (days.pv_kw, days.load_kw))
schedule = np.array([0.05] * 18 + [0.09] + [0.10] * 3 + [0.08] + [0.05])
commands_kw = level_commands(episode.scenario.battery_levels, one.homes)
best = best_response(
    one, pv_kw, load_kw, np.tile(schedule[:, None], (1, 32)), days.sell_price.T, commands_kw=commands_kw
).bill.mean()
print(f"{home}: conventional {rule:.3f} $/day, learned {learned:.3f}, best possible {best:.3f}")

# Save the network as a zengrid policy, which plays in the live market without torch.
layers = [part for part in learner.q_net.q_net if hasattr(part, "weight")]
PolicyFile(
    role="prosumer", observation="public", features=episode.features(home), offset=offset, scale=scale,
    levels=level_fractions(episode.scenario.battery_levels), activation="relu",
    layers=tuple(Layer(part.weight.detach().numpy(), part.bias.detach().numpy()) for part in layers),
    dt_h=episode.scenario.dt_h, name="sb3-dqn", training={"algorithm": "stable_baselines3.DQN", "slots": slots},
).save(f"{home}.safetensors")  # fmt: skip
