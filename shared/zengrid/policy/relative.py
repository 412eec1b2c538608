"""Homes of any size in units of their own battery: how one network serves them all."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.observe import ObservationKind, prosumer_features
from zengrid.core.params import Homes

Floats = NDArray[np.float64]

SIZES = ("battery_h", "pv_per_kw", "efficiency")
"""What follows a prosumer's features: usable capacity and rated PV power, each by the battery's power, and what comes
back of stored energy. [h], [-], [-]"""


def relative_features(kind: ObservationKind) -> tuple[str, ...]:
    """Names of what a network sees that serves homes of any size."""
    return (*prosumer_features(kind), *SIZES)


class Relative(NamedTuple):
    """What turns a home's observation into that of a network for homes of any size: ``x * factor + shift``, then sizes.

    The state of charge becomes the share of the usable capacity, powers multiples of the battery's power.
    """

    factor: Floats
    """(home, feature)"""
    shift: Floats
    """(home, feature)"""
    sizes: Floats
    """(home, size) numbers named by ``SIZES``"""

    @classmethod
    def of(cls, kind: ObservationKind, homes: Homes, pv_kw: Floats) -> Relative:
        """For batteries and rated PV powers ``(home,)`` [kW]."""
        names = prosumer_features(kind)
        power_kw = np.maximum(homes.charge_max_kw, homes.discharge_max_kw)
        power_kw = np.where(power_kw > 0.0, power_kw, 1.0)  # without a battery nothing depends on the commands
        width = homes.soc_max - homes.soc_min
        usable = np.where(width > 0.0, width, 1.0)
        factor, shift = np.ones((homes.count, len(names))), np.zeros((homes.count, len(names)))
        factor[:, names.index("soc")], shift[:, names.index("soc")] = 1.0 / usable, -homes.soc_min / usable
        for name in ("pv_kw", "load_kw"):
            factor[:, names.index(name)] = 1.0 / power_kw
        sizes = (width * homes.capacity_kwh, pv_kw, homes.charge_efficiency * homes.discharge_efficiency * power_kw)
        return cls(factor, shift, np.stack(sizes, axis=-1) / power_kw[:, None])

    def first(self) -> Relative:
        """For the first home alone."""
        return Relative(self.factor[:1], self.shift[:1], self.sizes[:1])

    def __call__(self, observation: Floats) -> Floats:
        """What the network sees, ``(..., home, feature)`` -> ``(..., home, feature + size)``."""
        own = observation * self.factor + self.shift
        return np.concatenate([own, np.broadcast_to(self.sizes, (*own.shape[:-1], self.sizes.shape[-1]))], axis=-1)
