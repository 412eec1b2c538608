"""Inputs and outcome of a slot: actions of the agents, PV, loads and tariff, and the settlement."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Action(NamedTuple):
    """Decisions of the agents for one slot.

    buy_price: ``(...)`` price at which the grid buys exports. [$/kWh]
    battery_kw: ``(..., home)`` command to each battery, > 0 charges. [kW]
    """

    buy_price: Floats
    battery_kw: Floats


class Exogenous(NamedTuple):
    """Inputs that no agent decides: PV, consumption and the posted tariff, as means over the slot.

    pv_kw, load_kw: ``(..., home)`` PV generation and consumption of each prosumer. [kW]
    consumer_kw: ``(..., consumer)`` consumption of each plain consumer. [kW]
    sell_price: ``(...)`` posted price at which the grid sells. [$/kWh]
    """

    pv_kw: Floats
    load_kw: Floats
    consumer_kw: Floats
    sell_price: Floats

    def slot(self, index: int) -> Exogenous:
        """One slot of a day: position ``index`` of the first axis."""
        return self.part(index)

    def part(self, index: Any) -> Exogenous:
        """The same part of every column (numpy indexing rules); all columns must have the indexed axes."""
        return Exogenous(self.pv_kw[index], self.load_kw[index], self.consumer_kw[index], self.sell_price[index])


class Settlement(NamedTuple):
    """Powers are means over the slot [kW]; money is for the whole slot [$].

    Shapes: ``(..., home)`` for what belongs to a home, ``(..., facility)`` for facilities, ``(...)`` for the market.
    """

    @property
    def is_finite(self) -> bool:
        """Whether every number of a single market is finite: the profit depends on all that is not in ``soc``."""
        return math.isfinite(self.profit + np.add.reduce(self.soc, axis=None))

    soc: Floats
    """(..., home) state of charge at the end of the slot [-]"""
    battery_kw: Floats
    """(..., home) actual power of the battery, > 0 charges [kW]"""
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
    """(..., home) payment of the grid for the export, Omega [$]"""
    bill: Floats
    """(..., home) cost of imports less payment for exports [$]"""
    consumer_payment: Floats
    """(...) payment of the plain consumers [$]"""
    export_kw: Floats
    """(...) sum of the homes' exports [kW]"""
    payments: Floats
    """(...) sum of the grid's payments for them [$]"""
    demand_kw: Floats
    """(...) P_dm, total demand that the grid sells to [kW]"""
    facility_kw: Floats
    """(..., facility) output of each facility [kW]"""
    facility_cost: Floats
    """(..., facility) F_i [$]"""
    curtailed_kw: Floats
    """(...) surplus below the first facility's minimum [kW]"""
    unserved_kw: Floats
    """(...) demand beyond all facilities [kW]"""
    revenue: Floats
    """(...) payments of all customers to the grid [$]"""
    lost_load_cost: Floats
    """(...) charge for unserved demand [$]"""
    profit: Floats
    """(...) revenue - facility costs - payments - lost load [$]"""
