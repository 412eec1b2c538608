"""Which facility produces how much, and what that costs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Market

Floats = NDArray[np.float64]


def dispatch(net_kw: Floats, market: Market) -> tuple[Floats, Floats, Floats]:
    """Cover the net demand by the facilities in their order, each up to its maximum.

    The first facility never runs below its minimum: what it then produces too much is curtailed. What all together
    cannot produce is unserved.

    Parameters
    ----------
    net_kw:
        Demand less exports, ``(...)``. [kW]

    Returns
    -------
    facility_kw, curtailed_kw, unserved_kw:
        ``(..., facility)``, ``(...)``, ``(...)``. [kW]
    """
    facilities = market.facilities
    left = net_kw[..., None] - market.facility_before_kw
    facility_kw = np.minimum(np.maximum(left, market.facility_floor_kw), facilities.p_max_kw)
    curtailed_kw = np.maximum(market.facility_floor_kw[0] - net_kw, 0.0)
    unserved_kw = np.maximum(net_kw - market.facility_total_kw, 0.0)
    return facility_kw, curtailed_kw, unserved_kw


def facility_cost(facility_kw: Floats, market: Market) -> Floats:
    """Cost of each facility over the slot, ``F_i = (a_i P^2 + b_i P + c_i) dt``, ``(..., facility)``. [$]"""
    facilities = market.facilities
    rate = (facilities.cost_a * facility_kw + facilities.cost_b) * facility_kw + facilities.cost_c
    return rate * market.dt_h
