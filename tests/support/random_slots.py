"""Markets, and slots to settle in them: drawn by hypothesis for properties, by a seed for sizes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.state import Action, Exogenous

Floats = NDArray[np.float64]


class Slot(NamedTuple):
    """The arguments of ``settle``."""

    soc: Floats
    action: Action
    exogenous: Exogenous
    market: MarketParams


def units(rows: int, columns: int) -> st.SearchStrategy[Floats]:
    """Numbers from 0 to 1, both ends likely; one draw for many quantities is what makes these tests quick."""
    return arrays(np.float64, (rows, columns), elements=st.floats(0.0, 1.0, allow_subnormal=False))


@st.composite
def homes(draw: st.DrawFn, count: int) -> Homes:
    """Homes with batteries of any size, none included."""
    drawn = draw(units(8, count))
    soc_min, soc_max = drawn[0] * 0.5, 0.5 + drawn[1] * 0.5
    return Homes(
        capacity_kwh=np.where(drawn[2] < 0.05, 0.0, drawn[2] * 30.0),
        charge_max_kw=drawn[3] * 5.0,
        discharge_max_kw=drawn[4] * 5.0,
        soc_min=soc_min,
        soc_max=soc_max,
        charge_efficiency=0.5 + drawn[5] * 0.5,
        discharge_efficiency=0.5 + drawn[6] * 0.5,
        injection_max_kw=0.5 + drawn[7] * 9.5,
        soc_initial=(soc_min + soc_max) / 2,
    )


@st.composite
def facilities(draw: st.DrawFn) -> Facilities:
    """One to four facilities, the first with a minimum output."""
    drawn = draw(units(5, draw(st.integers(1, 4))))
    p_max_kw = drawn[0] * 30.0
    p_min_kw = np.zeros_like(p_max_kw)
    p_min_kw[0] = p_max_kw[0] * drawn[1, 0]
    return Facilities(p_min_kw, p_max_kw, cost_a=drawn[2] * 0.05, cost_b=drawn[3] * 0.5, cost_c=drawn[4] * 2.0)


@st.composite
def slots(draw: st.DrawFn) -> Slot:
    """One slot of a small market without leading axes; commands may be far out of reach."""
    count = draw(st.integers(1, 5))
    owned = draw(homes(count))
    drawn = draw(units(4, count))
    prices = draw(units(2, 1)) * 0.5
    return Slot(
        soc=np.clip(owned.soc_min + drawn[0] * (owned.soc_max - owned.soc_min), owned.soc_min, owned.soc_max),
        action=Action(prices[0, 0], (2.0 * drawn[1] - 1.0) * draw(st.sampled_from([3.0, 1e9, 1e300]))),
        exogenous=Exogenous(
            pv_kw=drawn[2] * 12.0,
            load_kw=drawn[3] * 12.0,
            consumer_kw=draw(units(draw(st.integers(0, 3)), 1))[:, 0] * 40.0,
            sell_price=prices[1, 0],
        ),
        market=MarketParams(owned, draw(facilities()), dt_h=draw(st.sampled_from([1 / 12, 0.25, 0.5, 1.0, 2.0]))),
    )


def seeded(rng: np.random.Generator, count: int, lead: tuple[int, ...] = (), consumers: int = 2) -> Slot:
    """One slot of a market of any size, with leading axes; every limit is reached somewhere."""
    homes_ = Homes.of(
        capacity_kwh=rng.choice([0.0, 2.0, 6.0, 12.0], count),
        charge_max_kw=rng.uniform(0.5, 3.0, count),
        discharge_max_kw=rng.uniform(0.5, 3.0, count),
        charge_efficiency=rng.uniform(0.8, 1.0, count),
        discharge_efficiency=rng.uniform(0.8, 1.0, count),
        injection_max_kw=rng.uniform(1.0, 5.0, count),
    )
    plant = Facilities.of(
        p_max_kw=count * np.array([1.0, 0.5, 1.0]),
        cost_b=[0.03, 0.2, 0.33],
        cost_a=[0.0, 0.001, 0.012],
        cost_c=0.1,
        p_min_kw=[0.2 * count, 0.0, 0.0],
    )
    limits = rng.choice([0.0, 1.0], (*lead, count))
    return Slot(
        soc=np.where(rng.random((*lead, count)) < 0.3, 0.1 + 0.8 * limits, rng.uniform(0.1, 0.9, (*lead, count))),
        action=Action(rng.uniform(0.05, 0.1, lead), rng.choice([-9.0, -1.0, -0.0, 0.0, 0.7, 9.0], (*lead, count))),
        exogenous=Exogenous(
            pv_kw=np.maximum(rng.uniform(-2.0, 8.0, (*lead, count)), 0.0),
            load_kw=rng.uniform(0.0, 6.0, (*lead, count)),
            consumer_kw=rng.uniform(0.0, 2.0 * count, (*lead, consumers)),
            sell_price=rng.uniform(0.05, 0.1, lead),
        ),
        market=MarketParams(homes_, plant, dt_h=0.25),
    )
