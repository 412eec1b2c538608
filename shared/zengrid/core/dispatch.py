"""Dispatches generation facilities to cover demand, and computes their cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import MarketParams

Floats = NDArray[np.float64]


def dispatch(net_kw: Floats, market: MarketParams) -> tuple[Floats, Floats, Floats]:
    """Cover the net demand by the facilities in their order, each up to its maximum.

    The first facility never runs below its minimum; its surplus is curtailed. Demand beyond all maxima is unserved.

    Parameters
    ----------
    net_kw:
        Demand less exports, ``(...)``. [kW]

    Returns
    -------
    facility_kw, curtailed_kw, unserved_kw:
        ``(..., facility)``, ``(...)``, ``(...)``. [kW]
    """
    left = spread(net_kw) - market.stage_before_kw
    raised = np.maximum(left, market.stage_min_kw)
    stage_kw = np.minimum(raised, market.stage_max_kw)
    return stage_kw[..., :-1], raised[..., 0] - left[..., 0], stage_kw[..., -1]


def spread(value: Floats) -> Floats:
    """Add an axis to a value of the market, ``(...)``, so that it broadcasts over homes or facilities."""
    # A number broadcasts without an axis, and numpy computes with it in half the time.
    return value[..., None] if value.ndim else value


def facility_cost(facility_kw: Floats, market: MarketParams) -> Floats:
    """Cost of each facility over the slot, ``F_i = (a_i P^2 + b_i P + c_i) dt``, ``(..., facility)``. [$]"""
    return (facility_kw * market.slot_cost_a + market.slot_cost_b) * facility_kw + market.slot_cost_c
