"""One home: what its battery can do with a command, and what then crosses its meter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Market

Floats = NDArray[np.float64]


def battery_step(soc: Floats, command_kw: Floats, market: Market) -> tuple[Floats, Floats]:
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
        Power really taken [kW] and state of charge at the end of the slot [-], both ``(..., home)``.
    """
    homes = market.homes
    upper = np.minimum(homes.charge_max_kw, (homes.soc_max - soc) * market.charge_limit_kw)
    lower = np.minimum(homes.discharge_max_kw, (soc - homes.soc_min) * market.discharge_limit_kw)
    battery_kw = np.minimum(np.maximum(command_kw, -lower), upper)
    stored_kw = np.maximum(battery_kw, 0.0) * homes.charge_efficiency
    drawn_kw = np.minimum(battery_kw, 0.0) / homes.discharge_efficiency
    after = soc + (stored_kw + drawn_kw) * (market.dt_h * market.inverse_capacity)
    # The limits above hold in real numbers; this keeps the last bit of a float from crossing them.
    return battery_kw, np.minimum(np.maximum(after, homes.soc_min), homes.soc_max)


def meter(injection_kw: Floats, market: Market) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Apply the limit of the grid connection (paper eq. 6).

    Returns ``(injection, export, import, curtailed, unserved)``, each ``(..., home)`` in kW, where
    ``injection_kw = injection + curtailed - unserved``.
    """
    limit = market.homes.injection_max_kw
    wanted_export = np.maximum(injection_kw, 0.0)
    wanted_import = np.maximum(-injection_kw, 0.0)
    export_kw = np.minimum(wanted_export, limit)
    import_kw = np.minimum(wanted_import, limit)
    return export_kw - import_kw, export_kw, import_kw, wanted_export - export_kw, wanted_import - import_kw
