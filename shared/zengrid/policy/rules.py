"""Policies that follow a rule: for baselines, for tests, and as fallbacks that need no training."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import CONVENTIONAL_BUY_PRICE, conventional
from zengrid.core.levels import level_commands
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.views import GridView, ProsumerView
from zengrid.scenario.randomness import fork, keys_of, uniform

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
        return np.zeros_like(view.soc)


class RandomCommands:
    """Any of the battery levels; the same for the same seed, home, day and slot, whoever asks and in which order."""

    version = "1"

    def __init__(self, facts: MarketFacts, seed: int = 0) -> None:
        self.name = f"random:{seed}"
        self._commands = level_commands(facts.battery_levels, facts.homes)
        self._keys = keys_of([f"policy {home}" for home in facts.home_ids], seed)
        self._column = np.arange(len(facts.home_ids))

    def act(self, view: ProsumerView) -> Floats:
        """One level a home, ``(..., home)``. [kW]"""
        draw = uniform(fork(fork(self._keys, view.day), view.slot))
        level = (draw * len(self._commands)).astype(np.intp)
        return np.broadcast_to(self._commands[level, self._column], view.soc.shape).copy()


class FixedPrice:
    """The same price at all times."""

    version = "1"

    def __init__(self, facts: MarketFacts, price: float = CONVENTIONAL_BUY_PRICE) -> None:
        self.name = f"fixed:{price:g}"
        self._price = nearest_level(price, facts.buy_prices)

    def act(self, view: GridView) -> float:
        """The price. [$/kWh]"""
        return self._price


class TimeOfUse:
    """A price for each time of day, such as ``0.05,18:00=0.09,21:00=0.05``: the first counts from midnight."""

    version = "1"

    def __init__(self, facts: MarketFacts, schedule: str) -> None:
        self.name = f"tou:{schedule}"
        self.schedule = np.empty(facts.slots_per_day)
        for position, part in enumerate(schedule.split(",")):
            start, price = _from_time(part, position)
            first = int(np.ceil(round(start / facts.dt_h, 9)))
            self.schedule[first:] = nearest_level(price, facts.buy_prices)

    def act(self, view: GridView) -> float:
        """The price of this time of day. [$/kWh]"""
        return float(self.schedule[view.slot])


class RandomPrice:
    """Any of the price levels; the same for the same seed, day and slot."""

    version = "1"

    def __init__(self, facts: MarketFacts, seed: int = 0) -> None:
        self.name = f"random:{seed}"
        self._levels = facts.buy_prices
        self._key = keys_of(["policy grid"], seed)

    def act(self, view: GridView) -> float:
        """The price. [$/kWh]"""
        draw = uniform(fork(fork(self._key, view.day), view.slot))
        return self._levels[int(draw[0] * len(self._levels))]


def nearest_level(price: float, levels: tuple[float, ...]) -> float:
    """The permitted level that a price means; raises PolicyError where it is none."""
    for level in levels:
        if abs(level - price) <= 1e-9:
            return level
    raise PolicyError(f"price = {price:g}: permitted are {', '.join(f'{level:g}' for level in levels)} $/kWh")


_PART = re.compile(r"(?:(\d{1,2}):(\d{2})=)?([0-9.eE+-]+)$")


def _from_time(part: str, position: int) -> tuple[float, float]:
    """Hour from which a price counts, and the price. [h], [$/kWh]"""
    match = _PART.match(part.strip())
    timed = match is not None and match.group(1) is not None
    if match is None or timed != (position > 0):
        raise PolicyError(f"time of use = {part!r}: give a price, then HH:MM=price, such as 0.05,18:00=0.09,21:00=0.05")
    try:
        return int(match.group(1) or 0) + int(match.group(2) or 0) / 60, float(match.group(3))
    except ValueError:
        raise PolicyError(f"time of use = {part!r}: {match.group(3)!r} is not a price") from None
