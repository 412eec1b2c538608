"""The memory gives back what was seen, with its successor, and sums rewards up to the end of a day."""

from __future__ import annotations

import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from zengrid.learn.replay import Replay

NETWORKS, DAYS, SLOTS_A_DAY, GAMMA = 2, 3, 5, 0.5


def filled(slots: int, written: int, n_step: int) -> Replay:
    """Observation: the slot's number; reward: the same; action: its remainder."""
    replay = Replay(slots, NETWORKS, DAYS, 2, n_step, GAMMA, torch.device("cpu"))
    column = torch.arange(NETWORKS * DAYS).view(NETWORKS, DAYS).float()
    for slot in range(written):
        seen = torch.stack([torch.full((NETWORKS, DAYS), float(slot)), column], dim=-1)
        ends = slot % SLOTS_A_DAY == SLOTS_A_DAY - 1
        action = torch.full((NETWORKS, DAYS), slot % 4)
        replay.add(seen, action, torch.full((NETWORKS, DAYS), float(slot)), 0.1 * slot, not ends)
    return replay


@pytest.mark.parametrize(("slots", "written"), [(40, 12), (12, 40), (7, 100)])
@pytest.mark.parametrize("n_step", [1, 3])
def test_a_slot_comes_with_its_successor(slots: int, written: int, n_step: int) -> None:
    batch = filled(slots, written, n_step).draw(500, torch.Generator().manual_seed(0))
    slot = batch.seen[..., 0]
    assert slot.min() == max(0, written - slots)
    assert slot.max() == written - 1 - n_step
    assert torch.equal(batch.seen_next[..., 0], slot + n_step)
    assert torch.equal(batch.seen_next[..., 1], batch.seen[..., 1])
    assert torch.equal(batch.action, slot.long() % 4)
    assert torch.allclose(batch.sell_price, 0.1 * slot)
    network = torch.arange(NETWORKS)[:, None] * DAYS
    assert ((batch.seen[..., 1] >= network) & (batch.seen[..., 1] < network + DAYS)).all()
    for row in range(200):
        start = int(slot[0, row])
        reward, rest = 0.0, 1.0
        for ahead in range(n_step):
            reward += rest * (start + ahead)
            rest *= 0.0 if (start + ahead) % SLOTS_A_DAY == SLOTS_A_DAY - 1 else GAMMA
        assert float(batch.reward[0, row]) == pytest.approx(reward)
        assert float(batch.rest[0, row]) == pytest.approx(rest)


def test_too_little_is_an_error() -> None:
    with pytest.raises(ValueError, match="1 slots remembered: more than n_step = 1"):
        filled(10, 1, 1).draw(4, torch.Generator())
