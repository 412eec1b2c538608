"""What a policy may look at when it decides, and what deciding means. Leading axes (days side by side) are free."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes

Floats = NDArray[np.float64]
DayNumber = int | NDArray[np.int64]
"""One day, or one for each of several days that are played side by side, ``(...)``."""


class ProsumerView(NamedTuple):
    """One slot as the homes of one agent see it (paper eq. 15).

    soc, pv_kw, load_kw: ``(..., home)`` [-], [kW], [kW]. buy_price, sell_price: ``(...)`` of this slot [$/kWh].
    day: its number, one or ``(...)``. dt_h: slot length [h]. homes: the homes' batteries and meters.
    """

    day: DayNumber
    slot: int
    dt_h: float
    soc: Floats
    pv_kw: Floats
    load_kw: Floats
    buy_price: Floats | float
    sell_price: Floats | float
    homes: Homes


class GridView(NamedTuple):
    """One slot as the grid agent sees it (paper eq. 14): outcomes of the last slot, tariff of this one.

    facility_cost: F ``(..., facility)`` [$]. payment: Omega ``(..., home)`` [$], or None where only the sum is told.
    payments, demand_kw, sell_price: ``(...)`` [$], [kW], [$/kWh]. homes: their number.
    buy_prices: the permitted levels ``(level,)`` [$/kWh].
    """

    day: DayNumber
    slot: int
    dt_h: float
    facility_cost: Floats
    payment: Floats | None
    payments: Floats | float
    homes: int
    demand_kw: Floats | float
    sell_price: Floats | float
    buy_prices: Floats


class ProsumerPolicy(Protocol):
    """Commands batteries."""

    name: str
    version: str

    def act(self, view: ProsumerView) -> Floats:
        """Commands within each battery's power limits, > 0 charges, ``(..., home)``. [kW]"""
        ...


class GridPolicy(Protocol):
    """Sets the price at which the grid buys."""

    name: str
    version: str

    def act(self, view: GridView) -> Floats | float:
        """One of the permitted levels, ``(...)``. [$/kWh]"""
        ...
