"""From the join reply to what policies are told."""

from __future__ import annotations

from collections.abc import Sequence

from zengrid.core.params import Homes
from zengrid.policy.facts import MarketFacts
from zengrid.wire.queries import HomeLimits, JoinReply


def market_facts(market: JoinReply, homes: Sequence[HomeLimits]) -> MarketFacts:
    """What a policy for the given homes is told."""
    return MarketFacts(
        dt_h=market.dt_h,
        slots_per_day=market.slots_per_day,
        buy_prices=market.buy_prices,
        sell_prices=market.sell_prices,
        baseline_buy_price=market.baseline_buy_price,
        battery_levels=market.battery_levels,
        facilities=market.facilities,
        home_ids=tuple(home.id for home in homes),
        homes=Homes.from_rows(homes),
        soc_reset=market.soc_reset,
        scenario=market.scenario,
        pv_kw=tuple(home.pv_kw for home in homes),
    )
