"""What a policy is told about the market when its agent joins."""

from __future__ import annotations

from dataclasses import dataclass

from zengrid.core.params import Homes


@dataclass(frozen=True, slots=True)
class MarketFacts:
    """The part of a market that its agents know.

    home_ids, homes: the agent's own homes, in the order of all arrays (none for the grid agent).
    sell_prices: posted tariff, one a slot of the day [$/kWh]. buy_prices: levels the grid may set [$/kWh].
    battery_levels: number of command levels between full discharge and full charge.
    """

    dt_h: float
    slots_per_day: int
    buy_prices: tuple[float, ...]
    sell_prices: tuple[float, ...]
    battery_levels: int
    facilities: int
    home_ids: tuple[str, ...]
    homes: Homes
