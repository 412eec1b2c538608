"""What a policy is told about the market when its agent joins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes

Floats = NDArray[np.float64]
Foresight = Callable[[int], tuple[Floats, Floats]]
"""PV and consumption of a policy's homes on a day by its number, each ``(slot, home)``. [kW]"""


@dataclass(frozen=True, slots=True)
class MarketFacts:
    """The part of a market that its agents know.

    home_ids, homes: the agent's own homes, in the order of all arrays (none for the grid agent).
    pv_kw: rated PV power of these homes, where it is known [kW].
    sell_prices: posted tariff, one a slot of the day [$/kWh]. buy_prices: levels the grid may set [$/kWh].
    baseline_buy_price: buy price without demand response [$/kWh].
    battery_levels: number of command levels between full discharge and full charge.
    soc_reset: whether batteries begin every day alike or go on as they are. scenario: its name, where there is one.
    foresight: what the homes' days will bring, for policies that know the future.
    """

    dt_h: float
    slots_per_day: int
    buy_prices: tuple[float, ...]
    sell_prices: tuple[float, ...]
    baseline_buy_price: float
    battery_levels: int
    facilities: int
    home_ids: tuple[str, ...]
    homes: Homes
    soc_reset: Literal["daily", "never"] = "daily"
    scenario: str = ""
    foresight: Foresight | None = None
    pv_kw: tuple[float, ...] = ()
