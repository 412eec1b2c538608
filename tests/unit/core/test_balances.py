"""Energy and money balance in whatever the core settles, and an imbalance is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from support.random_slots import Slot, seeded, slots
from zengrid.core.balances import balances
from zengrid.core.settle import settle, total


def columns(slot: Slot) -> dict[str, NDArray[np.float64]]:
    """One settled slot as arrays ``(1,)`` and ``(1, ...)``."""
    settled = settle(slot.soc, slot.action, slot.exogenous, slot.market)
    values = {**slot.exogenous._asdict(), **settled._asdict(), "buy_price": slot.action.buy_price}
    for name in ("consumer_kw", "home_curtailed_kw", "home_unserved_kw"):
        values[name] = total(values[name])
    return {name: np.asarray(value, dtype=np.float64)[None] for name, value in values.items()}


@given(slots())
def test_whatever_the_core_settles_balances(slot: Slot) -> None:
    checked = list(balances(columns(slot), slot.market.dt_h))
    assert len(checked) == 10
    for balance in checked:
        assert not balance.broken.any(), balance.name


@pytest.mark.parametrize("by", [1e-6, np.nan])
@pytest.mark.parametrize("name", ["export_kw", "demand_kw", "injection_kw", "bill", "profit", "lost_load_cost"])
def test_an_imbalance_is_seen(name: str, by: float) -> None:
    slot = seeded(np.random.default_rng(1), 4)
    settled = columns(slot)
    settled[name] = settled[name] + by
    assert any(balance.broken.all() for balance in balances(settled, slot.market.dt_h))
