"""A batch of markets is a loop over markets, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.random_slots import Slot, seeded
from zengrid.core.observe import observe_grid, observe_prosumers, time_features
from zengrid.core.settle import settle
from zengrid.core.state import Action, Settlement


def one(slot: Slot, index: tuple[int, ...]) -> Slot:
    """A single market of a batch, in memory of its own."""
    soc, action, exogenous, market = slot
    alone = Action(*(np.array(value[index]) for value in action))
    return Slot(np.array(soc[index]), alone, type(exogenous)(*(np.array(x[index]) for x in exogenous)), market)


def assert_batch_is_loop(slot: Slot) -> None:
    batch = settle(*slot)
    for index in np.ndindex(slot.soc.shape[:-1]):
        alone = settle(*one(slot, index))
        for name, value, row in zip(Settlement._fields, alone, batch, strict=True):
            # Bytes, since 0.0 == -0.0 would hide a difference.
            assert np.asarray(value).tobytes() == np.asarray(row[index]).tobytes(), (name, index)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 9, 15, 16, 17, 127, 128, 129, 300])
@pytest.mark.parametrize("lead", [(1,), (5,), (2, 3)])
def test_batch_equals_loop(count: int, lead: tuple[int, ...]) -> None:
    assert_batch_is_loop(seeded(np.random.default_rng(count), count, lead))


@given(st.integers(0, 2**32 - 1), st.integers(0, 300), st.lists(st.integers(1, 3), max_size=3), st.integers(0, 20))
def test_batch_equals_loop_anywhere(seed: int, count: int, lead: list[int], consumers: int) -> None:
    assert_batch_is_loop(seeded(np.random.default_rng(seed), count, tuple(lead), consumers))


@pytest.mark.parametrize(("count", "lead"), [(10_001, (2,)), (3, (500,))])
def test_batch_equals_loop_beyond_the_buffer_of_numpy(count: int, lead: tuple[int, ...]) -> None:
    assert_batch_is_loop(seeded(np.random.default_rng(1), count, lead))


@pytest.mark.parametrize("count", [3, 9, 130])
def test_the_layout_in_memory_does_not_matter(count: int) -> None:
    slot = seeded(np.random.default_rng(2), count, (4, 5))
    fortran = Slot(
        np.asfortranarray(slot.soc),
        Action(*map(np.asfortranarray, slot.action)),
        type(slot.exogenous)(*map(np.asfortranarray, slot.exogenous)),
        slot.market,
    )
    for name, rows, columns in zip(Settlement._fields, settle(*slot), settle(*fortran), strict=True):
        assert np.array_equal(rows, columns), name
    assert_batch_is_loop(fortran)


def test_a_shared_profile_may_be_broadcast() -> None:
    """Many policies on the same day: the day needs no copies."""
    soc, action, exogenous, market = seeded(np.random.default_rng(3), 5, (4,))
    day = type(exogenous)(*(np.array(value[0]) for value in exogenous))
    shared = settle(soc, action, day, market)
    for index in range(4):
        alone = settle(soc[index], Action(action.buy_price[index], action.battery_kw[index]), day, market)
        assert np.array_equal(shared.bill[index], alone.bill)
        assert shared.profit[index] == alone.profit


@given(st.integers(0, 2**32 - 1), st.integers(1, 40))
def test_observations_of_a_batch_are_those_of_each_market(seed: int, count: int) -> None:
    slot = seeded(np.random.default_rng(seed), count, (3,))
    soc, action, exogenous, _ = slot
    settled, time = settle(*slot), time_features(7, 0.25)
    seen = observe_prosumers(
        "public", soc, exogenous.pv_kw, exogenous.load_kw, action.buy_price, exogenous.sell_price, time
    )
    grid = observe_grid("public", settled.facility_cost, settled.payment, settled.demand_kw, exogenous.sell_price, time)
    for index in range(3):
        part = one(slot, (index,))
        mine = settle(*part)
        today, prices = part.exogenous, (part.action.buy_price, part.exogenous.sell_price)
        assert np.array_equal(
            observe_prosumers("public", part.soc, today.pv_kw, today.load_kw, *prices, time), seen[index]
        )
        assert np.array_equal(
            observe_grid("public", mine.facility_cost, mine.payment, mine.demand_kw, prices[1], time), grid[index]
        )
