"""The conventional rule: baseline without demand response, and fallback for agents that do not answer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes

Floats = NDArray[np.float64]

BASELINE_BUY_PRICE = 0.05
"""Constant buy price without demand response (paper section III). [$/kWh]"""


def conventional(pv_kw: Floats, load_kw: Floats, homes: Homes) -> Floats:
    """Charge with PV surplus, discharge for the home's own deficit, never buy to store, inject when full.

    Returns the command of each battery, ``(..., home)``, within its power limits. [kW]
    """
    return np.minimum(np.maximum(pv_kw - load_kw, -homes.discharge_max_kw), homes.charge_max_kw)
