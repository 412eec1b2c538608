"""The keystone: one slot of the market, for one market or thousands side by side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.dispatch import dispatch, facility_cost
from zengrid.core.home import battery_step, meter
from zengrid.core.params import Market
from zengrid.core.state import Action, Exogenous, Settlement

Floats = NDArray[np.float64]


def settle(soc: Floats, action: Action, exogenous: Exogenous, market: Market) -> Settlement:
    """Settle one slot (paper eq. 1-13, with the sign of eq. 12 mended: importing costs money).

    Leading axes are free: none for the live market, ``(day,)`` for training. Every market along them is settled as if
    it were alone, to the last bit: all sums run over the last axis of C-contiguous arrays, which numpy adds in an
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
        With ``soc`` the state to continue from.
    """
    dt_h = market.dt_h
    # Money for one kW over the whole slot [$/kW]; [()] turns an array without axes into a number, which is faster.
    bought = np.asarray(action.buy_price)[()] * dt_h
    sold = np.asarray(exogenous.sell_price)[()] * dt_h
    battery_kw, soc_after = battery_step(soc, action.battery_kw, market)
    injection_kw, export_kw, import_kw, home_curtailed_kw, home_unserved_kw = meter(
        exogenous.pv_kw - exogenous.load_kw - battery_kw, market
    )

    consumer_kw = total(exogenous.consumer_kw)
    supply_kw = total(export_kw)
    demand_kw = consumer_kw + total(import_kw)
    facility_kw, curtailed_kw, unserved_kw = dispatch(demand_kw - supply_kw, market)

    cost = facility_cost(facility_kw, market)
    payment = export_kw * bought[..., None]
    bill = import_kw * sold[..., None] - payment
    revenue = demand_kw * sold
    lost_load_cost = unserved_kw * (market.value_of_lost_load * dt_h)
    profit = revenue - total(cost) - supply_kw * bought - lost_load_cost
    return Settlement(
        soc=soc_after,
        battery_kw=battery_kw,
        injection_kw=injection_kw,
        export_kw=export_kw,
        import_kw=import_kw,
        home_curtailed_kw=home_curtailed_kw,
        home_unserved_kw=home_unserved_kw,
        payment=payment,
        bill=bill,
        consumer_payment=consumer_kw * sold,
        demand_kw=demand_kw,
        facility_kw=facility_kw,
        facility_cost=cost,
        curtailed_kw=curtailed_kw,
        unserved_kw=unserved_kw,
        revenue=revenue,
        lost_load_cost=lost_load_cost,
        profit=profit,
    )


def total(values: Floats) -> Floats:
    """Sum over the last axis in an order that does not depend on the leading axes."""
    summed: Floats = np.add.reduce(np.ascontiguousarray(values), axis=-1)
    return summed
