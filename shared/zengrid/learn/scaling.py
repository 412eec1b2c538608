"""How observations and rewards are scaled, so that networks see numbers of about one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.dispatch import dispatch, facility_cost
from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.core.params import MarketParams
from zengrid.core.settle import total
from zengrid.core.state import Exogenous

Floats = NDArray[np.float64]


class Scaling(NamedTuple):
    """``(value - offset) * scale``, each ``(feature,)``, as policy files have it."""

    offset: Floats
    scale: Floats

    def __call__(self, values: Floats) -> NDArray[np.float32]:
        """Scaled, ``(..., feature)``."""
        return ((values - self.offset) * self.scale).astype(np.float32)

    @classmethod
    def between(cls, names: Sequence[str], ranges: dict[str, tuple[float, float]]) -> Scaling:
        """Bring the range of each feature to -1..1; one that never changes becomes 0."""
        low, high = np.array([ranges[name] for name in names]).T
        width = high - low
        return cls((low + high) / 2.0, np.where(width > 1e-9, 2.0 / np.maximum(width, 1e-9), 0.0))


class Scales(NamedTuple):
    """Scaling of what both kinds of agents see, and factors on what they earn. [1/$]"""

    grid: Scaling
    prosumer: Scaling
    grid_reward: float
    prosumer_reward: float


def scales(kind: ObservationKind, market: MarketParams, days: Exogenous, buy_prices: Floats) -> Scales:
    """Read from a market and its days ``(slot, day, ...)`` what numbers there will be.

    A reward of one is what a home pays for a slot at full battery power, and what the grid takes from its consumers in
    an average slot.
    """
    homes, dt_h, tariff = market.homes, market.dt_h, days.sell_price
    pv_kw, load_kw = days.pv_kw.max(axis=(0, 1)), days.load_kw.max(axis=(0, 1))
    power_kw = np.maximum(homes.charge_max_kw, homes.discharge_max_kw)
    power_kw = power_kw.reshape(-1, homes.count).max(axis=0)
    payment = (pv_kw + power_kw) * (float(buy_prices[-1]) * dt_h)
    consumers_kw = total(days.consumer_kw)
    demand_kw = float(consumers_kw.max() + load_kw.sum() / 2.0)
    produced_kw, _, _ = dispatch(np.array([0.0, demand_kw]), market)
    cost = facility_cost(produced_kw, market)
    ranges = {
        "soc": (0.0, 1.0),
        "pv_kw": (0.0, float(pv_kw.max())),
        "load_kw": (0.0, float(load_kw.max())),
        "buy_price": (float(buy_prices[0]), float(buy_prices[-1])),
        "time_sin": (-1.0, 1.0),
        "time_cos": (-1.0, 1.0),
        "sell_price": (float(tariff.min()), float(tariff.max())),
        "payments": (0.0, float(payment.sum())),
        "homes": (0.0, 2.0 * homes.count),
        "demand_kw": (0.0, demand_kw),
        **{f"facility_cost_{i + 1}": (float(cost[0, i]), float(cost[1, i])) for i in range(market.facilities.count)},
        **{f"payment_{j + 1}": (0.0, float(payment[j])) for j in range(homes.count)},
    }
    dearest = max(float(tariff.max()), float(buy_prices[-1]))
    return Scales(
        grid=Scaling.between(grid_features(kind, market.facilities.count, homes.count), ranges),
        prosumer=Scaling.between(prosumer_features(kind), ranges),
        grid_reward=1.0 / max(dearest * float(consumers_kw.mean()) * dt_h, 1e-6),
        prosumer_reward=1.0 / max(dearest * float(np.median(power_kw)) * dt_h, 1e-6),
    )
