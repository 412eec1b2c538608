"""Settles one slot of the market, for one market or thousands side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.dispatch import dispatch, facility_cost, spread
from zengrid.core.home_physics import battery_follow, battery_range, meter
from zengrid.core.params import MarketParams
from zengrid.core.state import Action, Exogenous, Settlement

Floats = NDArray[np.float64]


def settle(soc: Floats, action: Action, exogenous: Exogenous, market: MarketParams) -> Settlement:
    """Settle one slot (paper eq. 1-13, with the sign of eq. 12 corrected: importing costs money).

    Any leading axes are allowed: none for the live market, ``(day,)`` for training. Each market along them is settled
    as if it were alone, bit for bit: all sums run over the last axis of C-contiguous arrays, which numpy adds in an
    order that does not depend on the leading axes.

    Parameters
    ----------
    soc:
        State of charge at the start of the slot, ``(..., home)``. [-]
    action:
        Buy price ``(...)`` [$/kWh] and battery commands ``(..., home)`` [kW].
    exogenous:
        PV, loads and the posted sell price of the slot.
    market:
        Homes, facilities and slot length.

    Returns
    -------
    Settlement
        Its ``soc`` is the state of the next slot.
    """
    return conclude(prepare(soc, exogenous, market), action, market)


class Prepared(NamedTuple):
    """The part of a slot that is known before the agents act."""

    soc: Floats
    permitted_kw: tuple[Floats, Floats]
    """(..., home) lowest and highest power that each battery can take [kW]"""
    surplus_kw: Floats
    """(..., home) PV less load [kW]"""
    consumer_kw: Floats
    """(...) sum of the plain consumers [kW]"""
    sold: Floats
    """(...) price of one kW over the whole slot [$/kW]"""


def prepare(soc: Floats, exogenous: Exogenous, market: MarketParams) -> Prepared:
    """First part of ``settle``: a live market computes it while it waits for its agents."""
    return Prepared(
        soc,
        battery_range(soc, market),
        exogenous.pv_kw - exogenous.load_kw,
        total(exogenous.consumer_kw),
        _number(exogenous.sell_price) * market.dt_h,
    )


def conclude(prepared: Prepared, action: Action, market: MarketParams) -> Settlement:
    """Second part of ``settle``."""
    soc, permitted_kw, surplus_kw, consumer_kw, sold = prepared
    dt_h = market.dt_h
    bought = _number(action.buy_price) * dt_h
    battery_kw, soc_after = battery_follow(soc, action.battery_kw, permitted_kw, market)
    injection_kw, home_export_kw, home_import_kw, home_curtailed_kw, home_unserved_kw = meter(
        surplus_kw - battery_kw, market
    )

    export_kw = total(home_export_kw)
    demand_kw = consumer_kw + total(home_import_kw)
    facility_kw, curtailed_kw, unserved_kw = dispatch(demand_kw - export_kw, market)

    cost = facility_cost(facility_kw, market)
    payment = home_export_kw * spread(bought)
    bill = home_import_kw * spread(sold) - payment
    revenue = demand_kw * sold
    payments = export_kw * bought
    lost_load_cost = unserved_kw * (market.value_of_lost_load * dt_h)
    profit = revenue - total(cost) - payments - lost_load_cost
    return Settlement(
        soc=soc_after,
        battery_kw=battery_kw,
        injection_kw=injection_kw,
        home_export_kw=home_export_kw,
        home_import_kw=home_import_kw,
        home_curtailed_kw=home_curtailed_kw,
        home_unserved_kw=home_unserved_kw,
        payment=payment,
        bill=bill,
        consumer_payment=consumer_kw * sold,
        export_kw=export_kw,
        payments=payments,
        demand_kw=demand_kw,
        facility_kw=facility_kw,
        facility_cost=cost,
        curtailed_kw=curtailed_kw,
        unserved_kw=unserved_kw,
        revenue=revenue,
        lost_load_cost=lost_load_cost,
        profit=profit,
    )


def _number(value: Floats) -> Floats:
    """An array without axes as a number, which is faster."""
    number: Floats = np.asarray(value)[()]
    return number


def total(values: Floats) -> Floats:
    """Sum over the last axis in an order that does not depend on the leading axes."""
    summed: Floats = np.add.reduce(np.ascontiguousarray(values), axis=-1)
    return summed
