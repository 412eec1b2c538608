"""What a home computes about itself is what the core settles."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

import torch

from support.random_slots import seeded
from zengrid.core.levels import level_commands
from zengrid.core.observe import observe_prosumers
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.learn.own_model import OwnModel
from zengrid.learn.scaling import Scaling

LEVELS, DAYS, HOMES = 5, 50, 4


def test_outcomes_are_those_of_the_core() -> None:
    slot = seeded(np.random.default_rng(4), HOMES, (DAYS,))
    market, now, price = slot.market, slot.exogenous, slot.action.buy_price
    seen = observe_prosumers("public", slot.soc, now.pv_kw, now.load_kw, price, now.sell_price, (0.5, 0.5))
    scaling = Scaling(seen.mean(axis=(0, 1)), np.array([2.0, 0.3, 0.2, 20.0, 1.0, 1.0, 0.0]))
    model = OwnModel(market.homes, LEVELS, market.dt_h, scaling, 7.0, torch.device("cpu"))
    rows = torch.from_numpy(np.swapaxes(scaling(seen), 0, 1).copy())
    sell = torch.from_numpy(np.broadcast_to(now.sell_price, (HOMES, DAYS)).astype(np.float32))
    reward, after = model.outcomes(rows, sell, rows)
    commands = level_commands(LEVELS, market.homes)
    for level in range(LEVELS):
        settled = settle(slot.soc, Action(price, np.broadcast_to(commands[level], slot.soc.shape)), now, market)
        np.testing.assert_allclose(reward[..., level].numpy().T / 7.0, -settled.bill, atol=2e-6)
        soc = after[..., level, 0].numpy().T / scaling.scale[0] + scaling.offset[0]
        np.testing.assert_allclose(soc, settled.soc, atol=2e-6)
    # Nothing but the battery is touched.
    assert torch.equal(after[..., 1:], rows[:, :, None, 1:].expand_as(after[..., 1:]))


def test_any_charge_is_any_permitted_one() -> None:
    slot = seeded(np.random.default_rng(4), HOMES, (DAYS,))
    scaling = Scaling(np.zeros(7), np.ones(7))
    model = OwnModel(slot.market.homes, LEVELS, 0.25, scaling, 1.0, torch.device("cpu"))
    rows = torch.zeros((HOMES, 1000, 7))
    soc = model.any_charge(rows, torch.Generator().manual_seed(1))[..., 0].numpy()
    homes = slot.market.homes
    assert (soc >= homes.soc_min[:, None] - 1e-6).all()
    assert (soc <= homes.soc_max[:, None] + 1e-6).all()
    assert (np.ptp(soc, axis=1) > 0.95 * (homes.soc_max - homes.soc_min)).all()
