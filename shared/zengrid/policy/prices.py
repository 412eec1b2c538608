"""Prices as people write them: a level, or a schedule by time of day."""

from __future__ import annotations

import re
from collections.abc import Sequence

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
    before = -1
    for part in text.split(","):
        step = _STEP.match(part.strip())
        if step is None or (step["hour"] is None) != (before < 0):
            raise PolicyError(f"schedule = {text!r}: {part!r} is not understood; such as 0.05,18:00=0.09,21:00=0.05")
        minutes = 60 * int(step["hour"] or 0) + int(step["minute"] or 0)
        first = round(minutes / 60.0 / facts.dt_h)
        if abs(first * facts.dt_h * 60.0 - minutes) > 1e-6:
            raise PolicyError(f"schedule = {text!r}: {part!r} begins within a slot; slots last {facts.dt_h * 60:g} min")
        if first <= before:
            raise PolicyError(f"schedule = {text!r}: {part!r} must begin later than the part before it")
        schedule[first:] = price_level(_number(step["price"], text), facts.buy_prices)
        before = first
    return schedule


def _number(price: str, text: str) -> float:
    try:
        return float(price)
    except ValueError:
        raise PolicyError(f"schedule = {text!r}: {price!r} is not a price") from None
