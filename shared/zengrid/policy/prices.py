"""Prices as people write them: a level, or a schedule by time of day."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts

Floats = NDArray[np.float64]

_STEP = re.compile(r"(?:(?P<hour>[01]?\d|2[0-3]):(?P<minute>[0-5]\d)=)?(?P<price>[0-9.eE+-]+)$")


def price_level(price: float, levels: Sequence[float]) -> float:
    """The permitted level that a price means; raises PolicyError where it is none. [$/kWh]"""
    for level in levels:
        if abs(level - price) <= 1e-9:
            return level
    raise PolicyError(f"buy price = {price:g}: permitted are {', '.join(f'{level:g}' for level in levels)} $/kWh")


class Step(NamedTuple):
    """A price from a time of day on."""

    minutes: int
    """since midnight"""
    price: float
    """[$/kWh]"""


def price_steps(text: str) -> list[Step]:
    """Prices by time of day as they are written, such as ``0.05,18:00=0.09,21:00=0.05``.

    Raises
    ------
    PolicyError
        Where a part is no price, or a time not later than the one before.
    """
    steps: list[Step] = []
    for part in text.split(","):
        found = _STEP.match(part.strip())
        if found is None or (found["hour"] is None) != (not steps):
            raise PolicyError(f"schedule = {text!r}: {part!r} is not understood; such as 0.05,18:00=0.09,21:00=0.05")
        minutes = 60 * int(found["hour"] or 0) + int(found["minute"] or 0)
        if steps and minutes <= steps[-1].minutes:
            raise PolicyError(f"schedule = {text!r}: {part!r} must begin later than the part before it")
        steps.append(Step(minutes, _number(found["price"], text)))
    return steps


def price_schedule(text: str, facts: MarketFacts) -> Floats:
    """Prices by time of day, such as ``0.05,18:00=0.09,21:00=0.05``: the first counts from midnight.

    Returns
    -------
    ``(slot,)`` [$/kWh]

    Raises
    ------
    PolicyError
        Where a part is no price, a price no level, or a time not the start of a slot later than the one before.
    """
    schedule = np.empty(facts.slots_per_day)
    for minutes, price in price_steps(text):
        first = round(minutes / 60.0 / facts.dt_h)
        if abs(first * facts.dt_h * 60.0 - minutes) > 1e-6:
            time = f"{minutes // 60:02d}:{minutes % 60:02d}"
            raise PolicyError(f"schedule = {text!r}: {time} begins within a slot; slots last {facts.dt_h * 60:g} min")
        schedule[first:] = price_level(price, facts.buy_prices)
    return schedule


def _number(price: str, text: str) -> float:
    try:
        return float(price)
    except ValueError:
        raise PolicyError(f"schedule = {text!r}: {price!r} is not a price") from None
