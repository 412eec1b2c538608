"""Best responses: two ways to find them, checked against each other, against every possible day, and by `settle`."""

from __future__ import annotations

import itertools
from typing import Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.bounds import BestResponse, best_response, optimality_gap
from zengrid.core.leader import settle_day
from zengrid.core.levels import level_commands
from zengrid.core.milp import best_response_milp
from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.state import Exogenous
from zengrid.scenario import Days, load

Floats = NDArray[np.float64]


class Case(NamedTuple):
    """The arguments of ``best_response``."""

    market: MarketParams
    pv_kw: Floats
    load_kw: Floats
    buy_price: Floats
    sell_price: Floats


def drawn(
    seed: int,
    slots: int = 24,
    dt_h: float = 1.0,
    homes: int = 3,
    lossless: bool = False,
    dearer_to_sell: bool = False,
    limit_kw: float = 10.0,
) -> Case:
    """A day of some homes with batteries of any kind; with ``dearer_to_sell`` no hour buys above the sell price."""
    rng = np.random.default_rng(seed)
    efficiency = np.ones((2, homes)) if lossless else rng.uniform(0.85, 1.0, (2, homes))
    owned = Homes.of(
        capacity_kwh=rng.uniform(2.0, 15.0, homes),
        charge_max_kw=rng.uniform(1.0, 4.0, homes),
        discharge_max_kw=rng.uniform(1.0, 4.0, homes),
        charge_efficiency=efficiency[0],
        discharge_efficiency=efficiency[1],
        injection_max_kw=limit_kw,
        soc_initial=rng.uniform(0.1, 0.9, homes),
    )
    hour = np.arange(slots) * dt_h + (24.0 - slots * dt_h) / 2.0
    sun = np.maximum(np.sin((hour - 6.0) / 12.0 * np.pi), 0.0)[:, None]
    buy = rng.choice([0.05, 0.06, 0.07, 0.08, 0.09, 0.10], slots)
    sell = np.where(hour < 11.0, 0.05, 0.095)
    return Case(
        MarketParams(owned, Facilities.of(50.0, 0.1), dt_h),
        sun * rng.uniform(2.0, 6.0, homes) * rng.uniform(0.5, 1.0, (slots, homes)),
        rng.uniform(0.2, 3.0, (slots, homes)),
        buy,
        np.maximum(sell, buy) if dearer_to_sell else sell,
    )


def as_day(case: Case) -> Exogenous:
    return Exogenous(case.pv_kw, case.load_kw, np.zeros((*case.sell_price.shape, 0)), case.sell_price)


def settled_bill(case: Case, command_kw: Floats, soc: Floats | None = None) -> Floats:
    bill: Floats = settle_day(case.market, as_day(case), case.buy_price, command_kw, soc).bill.sum(axis=0)
    return bill


def check_replayed(case: Case, found: BestResponse) -> None:
    """What a best response claims is what ``settle`` makes of its commands."""
    settled = settle_day(case.market, as_day(case), case.buy_price, found.battery_kw)
    np.testing.assert_allclose(settled.battery_kw, found.battery_kw, rtol=0, atol=1e-12)
    np.testing.assert_allclose(settled.soc, found.soc[1:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(settled.bill.sum(axis=0), found.bill, rtol=0, atol=1e-12)


@pytest.mark.parametrize("terminal", ["free", "cyclic"])
@pytest.mark.parametrize(
    "case",
    [
        drawn(1, dearer_to_sell=True),
        drawn(2),
        drawn(3, lossless=True),
        drawn(4, slots=96, dt_h=0.25, homes=2, dearer_to_sell=True),
        drawn(5, slots=12, limit_kw=2.5),
    ],
    ids=["convex", "buying above selling", "lossless", "15 min", "narrow meters"],
)
def test_dynamic_program_and_mixed_integer_program_agree(case: Case, terminal: Literal["free", "cyclic"]) -> None:
    lattice, exact = best_response(*case, terminal=terminal), best_response_milp(*case, terminal=terminal)
    assert np.all(lattice.bill >= exact.bill - 1e-6)
    narrow = bool(np.any(case.market.homes.injection_max_kw < 10.0))
    assert np.all(lattice.bill <= exact.bill + (0.02 if narrow else 0.005))
    for found in (lattice, exact):
        check_replayed(case, found)
        if terminal == "cyclic":
            assert np.all(found.soc[-1] >= found.soc[0] - 1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_with_levels_it_is_the_best_of_all_sequences(seed: int) -> None:
    case = drawn(seed, slots=6, homes=2, lossless=True)
    commands = level_commands(3, case.market.homes)
    found = best_response(*case, commands_kw=commands)
    sequences = np.array(list(itertools.product(range(3), repeat=6)))
    # Every sequence side by side, as if each were a day.
    every = commands[sequences.T]
    wide = Case(
        case.market, case.pv_kw[:, None], case.load_kw[:, None], case.buy_price[:, None], case.sell_price[:, None]
    )
    np.testing.assert_allclose(found.bill, settled_bill(wide, every).min(axis=0), rtol=0, atol=1e-8)
    check_replayed(case, found)


def test_levels_of_lossy_batteries_are_interpolated_and_still_attained() -> None:
    case = drawn(7, slots=6, homes=2)
    commands = level_commands(3, case.market.homes)
    found = best_response(*case, commands_kw=commands)
    every = commands[np.array(list(itertools.product(range(3), repeat=6))).T]
    wide = Case(
        case.market, case.pv_kw[:, None], case.load_kw[:, None], case.buy_price[:, None], case.sell_price[:, None]
    )
    least = settled_bill(wide, every).min(axis=0)
    assert np.all(found.bill >= least - 1e-12)
    assert np.all(found.bill <= least + 0.005)
    check_replayed(case, found)


BEATEN = drawn(11, homes=2)
BEST = best_response_milp(*BEATEN)


@given(st.integers(0, 2**32 - 1))
def test_no_commands_beat_the_best_response(seed: int) -> None:
    rng = np.random.default_rng(seed)
    commands = rng.uniform(-4.0, 4.0, BEATEN.pv_kw.shape) * rng.integers(0, 2, BEATEN.pv_kw.shape)
    assert np.all(settled_bill(BEATEN, commands) >= BEST.bill - 1e-6)


def test_days_side_by_side_are_as_if_alone() -> None:
    cases = [drawn(seed, homes=2) for seed in range(3)]
    market = cases[0].market
    batch = Case(market, *(np.stack(column, axis=1) for column in zip(*(case[1:] for case in cases), strict=True)))
    start = np.array([[0.3, 0.8], [0.1, 0.9], [0.5, 0.5]])
    together = best_response(*batch, soc=start, terminal="cyclic")
    for i, case in enumerate(cases):
        alone = best_response(market, *case[1:], soc=start[i], terminal="cyclic")
        for many, one in zip(together, alone, strict=True):
            assert np.array_equal(many[..., i, :], one)


def test_a_home_is_alone_with_its_prices() -> None:
    case = drawn(12, homes=3)
    for commands in (None, level_commands(5, case.market.homes)):
        together = best_response(*case, commands_kw=commands)
        for home in range(3):
            one = slice(home, home + 1)
            alone = best_response(
                case.market.with_homes(case.market.homes.take([home])), case.pv_kw[:, one], case.load_kw[:, one],
                case.buy_price, case.sell_price, commands_kw=None if commands is None else commands[:, one],
            )  # fmt: skip
            assert np.array_equal(together.battery_kw[:, one], alone.battery_kw)


def test_without_a_battery_there_is_nothing_to_decide() -> None:
    case = drawn(13)
    bare = case._replace(market=case.market.with_capacity(0.0))
    for found in (best_response(*bare), best_response_milp(*bare), best_response(*bare, terminal="cyclic")):
        assert np.all(found.battery_kw == 0.0)
        check_replayed(bare, found)


def test_of_equal_days_it_takes_the_one_with_the_emptier_battery() -> None:
    market = MarketParams(Homes.of([6.0], soc_initial=0.5), Facilities.of(50.0, 0.1), 1.0)
    flat = np.full(4, 0.08)
    nothing = np.zeros((4, 1))
    empty = best_response(market, nothing, nothing, flat, flat)
    full = best_response(market, nothing, nothing, flat, flat, hold_price=-1e-9, terminal="cyclic")
    assert empty.soc[:, 0].tolist() == pytest.approx([0.5, 1 / 6, 0.1, 0.1, 0.1])
    assert full.soc[1:3, 0].tolist() == pytest.approx([5 / 6, 0.9])


PAPER = load("paper").with_(noise="off")
EVENING_SCHEDULE = np.array([0.05] * 18 + [0.09] + [0.10] * 3 + [0.08] + [0.05])


@pytest.mark.parametrize("levels", [9, None])
def test_the_bound_on_the_case_study(levels: int | None) -> None:
    """With commands every 0.5 kW the bills of its table; any power saves prosumer 2 half a cent more."""
    market, day = PAPER.market(), Days(PAPER).day(0)
    case = Case(market, day.pv_kw, day.load_kw, EVENING_SCHEDULE, day.sell_price)
    commands = None if levels is None else level_commands(levels, market.homes)
    found = best_response(*case, commands_kw=commands)
    assert np.round(found.bill, 3).tolist() == [0.071, 0.150 if levels else 0.145, 0.313]
    exact = best_response_milp(*case)
    assert np.all(found.bill >= exact.bill - 1e-8)
    if levels is None:
        np.testing.assert_allclose(found.bill, exact.bill, rtol=0, atol=1e-6)


def test_the_gap_is_what_a_best_response_would_gain() -> None:
    case = drawn(21, lossless=True)
    best = best_response(*case)
    assert np.all(optimality_gap(*case, best.bill) == 0.0)
    rule = conventional(case.pv_kw, case.load_kw, case.market.homes)
    gap = optimality_gap(*case, settled_bill(case, rule))
    assert np.all(gap > 0.0)
    np.testing.assert_allclose(gap, settled_bill(case, rule) - best.bill, rtol=0, atol=1e-12)
