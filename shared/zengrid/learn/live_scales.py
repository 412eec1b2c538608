"""How a learner in a running market scales what it sees and earns: from what its first day brought."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zengrid.learn.scaling import Scaling
from zengrid.policy.facts import MarketFacts

Floats = NDArray[np.float64]

MARGIN = 1.25
"""How far beyond what the first day brought quantities are expected to go. [-]"""


def first_day_scaling(features: Sequence[str], rows: Floats, facts: MarketFacts) -> Scaling:
    """Scales of observations.

    Parameters
    ----------
    features:
        Names of what is seen.
    rows:
        What was seen, ``(row, feature)``.
    facts:
        What is known of the market.
    """
    cheapest, dearest = min(facts.buy_prices), max(facts.buy_prices)
    low, high = dict(zip(features, rows.min(axis=0), strict=True)), dict(zip(features, rows.max(axis=0), strict=True))
    ranges: dict[str, tuple[float, float]] = {
        "soc": (0.0, 1.0),
        "time_sin": (-1.0, 1.0),
        "time_cos": (-1.0, 1.0),
        "buy_price": (cheapest, dearest),
        "sell_price": (min(facts.sell_prices), max(facts.sell_prices)),
        "homes": (0.0, 2.0 * float(high.get("homes", 0.0))),
    }
    for name in features:
        if name in ("pv_kw", "load_kw"):
            # A first day without sun must not make the learner blind to it.
            ranges[name] = 0.0, max(MARGIN * float(high[name]), power_kw(facts))
        elif name.startswith("facility_cost"):
            ranges[name] = float(low[name]), MARGIN * float(high[name])
        elif name.startswith("payment"):
            # Seen at the rule's price, which is among the lowest.
            ranges[name] = 0.0, MARGIN * float(high[name]) * dearest / max(cheapest, 1e-3 * dearest)
        elif name == "demand_kw":
            ranges[name] = 0.0, MARGIN * float(high[name])
    return Scaling.between(features, ranges)


def reward_scale(facts: MarketFacts, usual_kw: float) -> float:
    """Factor on money, so that a usual power for one slot at the highest price is one. [1/$]"""
    return 1.0 / max(max(*facts.buy_prices, *facts.sell_prices) * usual_kw * facts.dt_h, 1e-6)


def power_kw(facts: MarketFacts) -> float:
    """A usual battery power of an agent's homes. [kW]"""
    return float(np.median(np.maximum(facts.homes.charge_max_kw, facts.homes.discharge_max_kw)))
