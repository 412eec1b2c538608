"""Policies that follow a rule: for baselines, for tests, and as fallbacks that need no training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.levels import level_fractions, to_commands
from zengrid.policy.facts import MarketFacts
from zengrid.policy.prices import price_level, price_schedule
from zengrid.policy.views import DayNumber, GridView, ProsumerView
from zengrid.scenario.randomness import RandomKeys, fork, keys_of, uniform

Floats = NDArray[np.float64]


class Conventional:
    """Store PV surplus, cover the own deficit, never buy to store, inject when full (paper section III)."""

    name = "conventional"
    version = "1"

    def act(self, view: ProsumerView) -> Floats:
        """Commands, ``(..., home)``. [kW]"""
        return conventional(view.pv_kw, view.load_kw, view.homes)


class Idle:
    """Leave the batteries alone."""

    name = "idle"
    version = "1"

    def act(self, view: ProsumerView) -> Floats:
        """Zeros, ``(..., home)``. [kW]"""
        return np.zeros(view.soc.shape)


class RandomCommands:
    """Any of the battery levels; the same for the same seed, home, day and slot, whoever asks and in which order."""

    version = "1"

    def __init__(self, facts: MarketFacts, seed: int = 0) -> None:
        self.name = f"random:{seed}"
        self._fractions = level_fractions(facts.battery_levels)
        self._keys = keys_of([f"policy {home}" for home in facts.home_ids], seed)

    def act(self, view: ProsumerView) -> Floats:
        """One level a home, ``(..., home)``. [kW]"""
        drawn = self._fractions[_draw(self._keys, view.day, view.slot, self._fractions.size)]
        return np.broadcast_to(to_commands(drawn, view.homes), view.soc.shape).copy()


class FixedPrice:
    """The same price at all times."""

    version = "1"

    def __init__(self, facts: MarketFacts, price: float) -> None:
        self.name = f"fixed:{price:g}"
        self._price = price_level(price, facts.buy_prices)

    def act(self, view: GridView) -> float:
        """The price. [$/kWh]"""
        return self._price


class TimeOfUse:
    """A price for each time of day, such as ``0.05,18:00=0.09,21:00=0.05``: the first counts from midnight."""

    version = "1"

    def __init__(self, facts: MarketFacts, schedule: str) -> None:
        self.name = f"tou:{schedule}"
        self._schedule = price_schedule(schedule, facts).tolist()

    def act(self, view: GridView) -> float:
        """The price of this time of day. [$/kWh]"""
        price: float = self._schedule[view.slot]
        return price


class RandomPrice:
    """Any of the price levels; the same for the same seed, day and slot."""

    version = "1"

    def __init__(self, facts: MarketFacts, seed: int = 0) -> None:
        self.name = f"random:{seed}"
        self._levels = np.array(facts.buy_prices)
        self._key = keys_of(["policy grid"], seed)

    def act(self, view: GridView) -> Floats:
        """The price, ``(...)``. [$/kWh]"""
        price: Floats = self._levels[_draw(self._key, view.day, view.slot, self._levels.size)[..., 0]]
        return price


def _draw(keys: RandomKeys, day: DayNumber, slot: int, levels: int) -> NDArray[np.intp]:
    """Position of a level for each key, ``(..., key)``."""
    return (uniform(fork(fork(keys, np.asarray(day)[..., None]), slot)) * levels).astype(np.intp)
