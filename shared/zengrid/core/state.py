"""What changes from slot to slot: stored energy, what everyone does, what the day brings, and what came of it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Action(NamedTuple):
    """What the agents decided for one slot.

    buy_price: ``(...)`` price at which the grid buys exports. [$/kWh]
    battery_kw: ``(..., home)`` command to each battery, > 0 charges. [kW]
    """

    buy_price: Floats
    battery_kw: Floats


class Exogenous(NamedTuple):
    """What nobody decides: weather, needs and the posted tariff, as means over the slot.

    pv_kw, load_kw: ``(..., home)`` PV generation and consumption of each prosumer. [kW]
    consumer_kw: ``(..., consumer)`` consumption of each plain consumer. [kW]
    sell_price: ``(...)`` posted price at which the grid sells. [$/kWh]
    """

    pv_kw: Floats
    load_kw: Floats
    consumer_kw: Floats
    sell_price: Floats

    def slot(self, index: int) -> Exogenous:
        """One slot of a day: takes position ``index`` of the first axis."""
        return self.part(index)

    def part(self, index: Any) -> Exogenous:
        """The same part of every column (numpy indexing rules); the first axes must be alike in all of them."""
        return Exogenous(self.pv_kw[index], self.load_kw[index], self.consumer_kw[index], self.sell_price[index])


class Settlement(NamedTuple):
    """Powers are means over the slot [kW]; money is for the whole slot [$].

    Shapes: ``(..., home)`` for what belongs to a home, ``(..., facility)`` for facilities, ``(...)`` for the market.
    """

    @property
    def is_finite(self) -> bool:
        """Whether every number of a single market is finite: the profit adds up all that is not in ``soc``."""
        return math.isfinite(self.profit + np.add.reduce(self.soc, axis=None))

    soc: Floats
    """(..., home) state of charge at the end of the slot [-]"""
    battery_kw: Floats
    """(..., home) what the battery really did, > 0 charges [kW]"""
    injection_kw: Floats
    """(..., home) at the meter after its limits, > 0 exports [kW]"""
    home_export_kw: Floats
    """(..., home) [kW]"""
    home_import_kw: Floats
    """(..., home) [kW]"""
    home_curtailed_kw: Floats
    """(..., home) export refused by the meter's limit [kW]"""
    home_unserved_kw: Floats
    """(..., home) import refused by the meter's limit [kW]"""
    payment: Floats
    """(..., home) what the grid pays for the export, Omega [$]"""
    bill: Floats
    """(..., home) cost of imports less payment for exports [$]"""
    consumer_payment: Floats
    """(...) what the plain consumers pay [$]"""
    export_kw: Floats
    """(...) all that the homes export [kW]"""
    payments: Floats
    """(...) all that the grid pays for it [$]"""
    demand_kw: Floats
    """(...) P_dm, all that the grid sells [kW]"""
    facility_kw: Floats
    """(..., facility) output of each facility [kW]"""
    facility_cost: Floats
    """(..., facility) F_i [$]"""
    curtailed_kw: Floats
    """(...) surplus below the first facility's minimum [kW]"""
    unserved_kw: Floats
    """(...) demand beyond all facilities [kW]"""
    revenue: Floats
    """(...) what all customers pay the grid [$]"""
    lost_load_cost: Floats
    """(...) charge for unserved demand [$]"""
    profit: Floats
    """(...) revenue - facility costs - payments - lost load [$]"""
