"""A stack of learners is each of them alone, and finds what is best in a small world."""

from __future__ import annotations

from dataclasses import replace

import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from zengrid.learn.dqn import DQN, Stack
from zengrid.learn.networks import forward, fresh
from zengrid.learn.settings import Learning, Settings

SMALL = Learning(hidden=(16,), batch=32, lr=1e-2, lr_end=1e-2, gamma=0.9, soft_target=0.1)


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("clock", [None, 3])
def test_a_stack_is_its_networks(activation: str, clock: int | None) -> None:
    weights = fresh(3, (7, 32, 8, 5), torch.Generator().manual_seed(1), clock)
    rows = torch.randn((3, 11, 7), generator=torch.Generator().manual_seed(2))
    together = forward(weights, rows, activation)  # type: ignore[arg-type]
    for i in range(3):
        values = rows[i]
        for layer in (0, 2):
            bend = torch.relu if activation == "relu" else torch.tanh
            values = bend(values @ weights[layer][i] + weights[layer + 1][i])
        assert torch.allclose(together[i], values @ weights[-2][i] + weights[-1][i], atol=1e-5)


def corridor(learning: Learning, updates: int = 400) -> DQN:
    """Four places in a row; going right costs a little, and pays 1 from the last one, where the day ends.

    Two learners live in it at once; for the second one left is right.
    """
    learners = DQN(Stack(2, 8, 4, 2), replace(learning, memory=4096, average=0.9), torch.Generator().manual_seed(3))
    generator = torch.Generator().manual_seed(4)
    place = torch.zeros((2, 8), dtype=torch.int64)
    for step in range(updates):
        seen = torch.nn.functional.one_hot(place, 4).float()
        action = torch.randint(2, (2, 8), generator=generator)
        right = action == torch.tensor([[1], [0]])
        reward = torch.where(right, torch.where(place == 3, 1.0, -0.02), 0.0)
        ends = step % 6 == 5
        learners.replay.add(seen, action, reward, 0.0, not ends)
        place = torch.where(right, (place + 1).clamp(max=3), (place - 1).clamp(min=0))
        if ends:
            place = torch.zeros_like(place)
        if step > learning.n_step:
            learners.learn(step / updates)
    return learners


@pytest.mark.parametrize(
    "learning",
    [SMALL, replace(SMALL, double=False, huber=False), replace(SMALL, activation="tanh")],
    ids=["default", "plain", "tanh"],
)
def test_learners_find_the_way_each_for_itself(learning: Learning) -> None:
    learners = corridor(learning)
    seen = torch.eye(4).expand(2, 4, 4)
    for weights in (learners.online, learners.averaged):
        assert learners.q(weights, seen).argmax(-1).tolist() == [[1, 1, 1, 1], [0, 0, 0, 0]]


def test_what_is_random_is_decided_by_the_generator() -> None:
    one, other = corridor(SMALL, 60), corridor(SMALL, 60)
    assert all(torch.equal(a, b) for a, b in zip(one.online, other.online, strict=True))


def test_settings_reach_one_kind_or_both() -> None:
    settings = Settings.preset("fast").with_(lr=0.5, grid_batch=7, steps=9)
    assert (settings.grid.lr, settings.prosumer.lr, settings.grid.batch, settings.steps) == (0.5, 0.5, 7, 9)
    assert settings.prosumer.batch != 7
    assert Settings.of(settings.as_dict()) == settings
