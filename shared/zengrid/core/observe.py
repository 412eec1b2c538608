"""Observations of the agents (paper eq. 14-15), as vectors for learners and trained policies."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
ObservationKind = Literal["paper", "public"]


def time_features(slot: int, dt_h: float) -> tuple[float, float]:
    """Sine and cosine of the time of day at the start of a slot. [-]"""
    angle = 2.0 * math.pi * (slot * dt_h) / 24.0
    return math.sin(angle), math.cos(angle)


def prosumer_features(kind: ObservationKind) -> tuple[str, ...]:
    """Names of a prosumer's observation, in order."""
    own = ("soc", "pv_kw", "load_kw", "buy_price")
    return own if kind == "paper" else (*own, "time_sin", "time_cos", "sell_price")


def grid_features(kind: ObservationKind, facilities: int, homes: int) -> tuple[str, ...]:
    """Names of the grid's observation, in order.

    ``paper`` lists every home's payment; ``public`` gives their sum and count, so that homes may come and go.
    """
    costs = tuple(f"facility_cost_{i + 1}" for i in range(facilities))
    if kind == "paper":
        return (*costs, *(f"payment_{j + 1}" for j in range(homes)), "demand_kw")
    return (*costs, "payments", "homes", "demand_kw", "time_sin", "time_cos", "sell_price")


def observe_prosumers(
    kind: ObservationKind,
    soc: Floats,
    pv_kw: Floats,
    load_kw: Floats,
    buy_price: Floats | float,
    sell_price: Floats | float,
    time: tuple[float, float],
) -> Floats:
    """Local observations of all homes in this slot (paper eq. 15), ``(..., home, feature)``.

    Parameters
    ----------
    soc, pv_kw, load_kw:
        ``(..., home)``. [-], [kW], [kW]
    buy_price, sell_price:
        Prices of this slot, ``(...)`` or one number. [$/kWh]
    time:
        Sine and cosine of the time of day, from ``time_features``.
    """
    features = np.empty((*soc.shape, len(prosumer_features(kind))))
    features[..., 0] = soc
    features[..., 1] = pv_kw
    features[..., 2] = load_kw
    features[..., 3] = np.asarray(buy_price)[..., None]
    if kind == "public":
        features[..., 4] = time[0]
        features[..., 5] = time[1]
        features[..., 6] = np.asarray(sell_price)[..., None]
    return features


def observe_grid(
    kind: ObservationKind,
    facility_cost: Floats,
    payment: Floats,
    demand_kw: Floats | float,
    sell_price: Floats | float,
    time: tuple[float, float],
) -> Floats:
    """Observation of the grid from the last settled slot (paper eq. 14), ``(..., feature)``.

    Parameters
    ----------
    facility_cost:
        F of the last slot, ``(..., facility)``; zeros before the first. [$]
    payment:
        Omega of the last slot, ``(..., home)``; zeros before the first. [$]
    demand_kw:
        P_dm of the last slot, ``(...)``. [kW]
    sell_price:
        Posted price of the coming slot, ``(...)``; used by ``public`` alone. [$/kWh]
    time:
        Sine and cosine of the coming slot's time of day; used by ``public`` alone.
    """
    facilities, homes = facility_cost.shape[-1], payment.shape[-1]
    features = np.empty((*facility_cost.shape[:-1], len(grid_features(kind, facilities, homes))))
    features[..., :facilities] = facility_cost
    if kind == "paper":
        features[..., facilities : facilities + homes] = payment
        features[..., -1] = demand_kw
        return features
    features[..., facilities] = np.add.reduce(np.ascontiguousarray(payment), axis=-1)
    features[..., facilities + 1] = homes
    features[..., facilities + 2] = demand_kw
    features[..., facilities + 3] = time[0]
    features[..., facilities + 4] = time[1]
    features[..., facilities + 5] = sell_price
    return features
