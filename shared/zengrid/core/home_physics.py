"""Battery and meter of a home: power and energy limits of the battery, and the limit of the grid connection."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import MarketParams

Floats = NDArray[np.float64]

ZERO = np.zeros(())  # numpy takes an array much faster than a Python number


def battery_range(soc: Floats, market: MarketParams) -> tuple[Floats, Floats]:
    """Lowest and highest power that the batteries' power and energy limits allow, ``(..., home)`` each. [kW]"""
    homes = market.homes
    upper = np.minimum((homes.soc_max - soc) * market.kw_per_soc_charged, homes.charge_max_kw)
    lower = np.maximum((homes.soc_min - soc) * market.kw_per_soc_drawn, market.battery_min_kw)
    return lower, upper


def battery_follow(
    soc: Floats, command_kw: Floats, permitted: tuple[Floats, Floats], market: MarketParams
) -> tuple[Floats, Floats]:
    """Do the same as ``battery_step`` with a range of powers that is already known."""
    lower, upper = permitted
    battery_kw = np.minimum(np.maximum(command_kw, lower), upper)
    # Losses always leave less in the battery, so the smaller product belongs to the actual direction.
    after = soc + np.minimum(battery_kw * market.soc_per_kw_charged, battery_kw * market.soc_per_kw_drawn)
    # The limits hold in real numbers; this keeps the last bit of a float from crossing them.
    return battery_kw, np.minimum(np.maximum(after, market.homes.soc_min), market.homes.soc_max)


def battery_step(soc: Floats, command_kw: Floats, market: MarketParams) -> tuple[Floats, Floats]:
    """Follow a command as far as the battery's power and energy limits allow.

    ``dSoC = (e_c max(P, 0) - max(-P, 0) / e_d) dt / capacity`` (paper eq. 13, with efficiencies).

    Parameters
    ----------
    soc:
        State of charge at the start of the slot, ``(..., home)``. [-]
    command_kw:
        Commanded power, > 0 charges, any finite value, ``(..., home)``. [kW]
    market:
        Battery limits and slot length.

    Returns
    -------
    battery_kw, soc:
        Actual power [kW] and state of charge at the end of the slot [-], both ``(..., home)``.
    """
    return battery_follow(soc, command_kw, battery_range(soc, market), market)


def meter(injection_kw: Floats, market: MarketParams) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Apply the limit of the grid connection (paper eq. 6).

    Returns ``(injection, export, import, curtailed, unserved)``, each ``(..., home)`` in kW, where
    ``injection_kw = injection + curtailed - unserved``.
    """
    limited_kw = np.minimum(np.maximum(injection_kw, market.injection_min_kw), market.homes.injection_max_kw)
    export_kw = np.maximum(limited_kw, ZERO)
    refused_kw = injection_kw - limited_kw
    curtailed_kw = np.maximum(refused_kw, ZERO)
    return limited_kw, export_kw, export_kw - limited_kw, curtailed_kw, curtailed_kw - refused_kw
