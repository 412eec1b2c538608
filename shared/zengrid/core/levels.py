"""Battery commands that learners, random policies and lattice programs choose from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes

Floats = NDArray[np.float64]


def level_fractions(count: int) -> Floats:
    """Evenly spread fractions of full power, from -1 (discharge) to 1 (charge), ``(count,)``. [-]"""
    if count < 2:
        raise ValueError(f"count = {count}: at least 2 battery levels are needed")
    return np.linspace(-1.0, 1.0, count)


def to_commands(fraction: Floats, homes: Homes) -> Floats:
    """Fractions of each home's largest charging or discharging power as commands, ``(..., home)``. [kW]"""
    commands: Floats = np.where(fraction > 0.0, homes.charge_max_kw, homes.discharge_max_kw) * fraction
    return commands


def level_commands(count: int, homes: Homes) -> Floats:
    """Every level of every home, discharging first, ``(level, home)``. [kW]"""
    return to_commands(level_fractions(count)[:, None], homes)
