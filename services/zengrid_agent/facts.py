"""From the join reply to what policies are told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zengrid.core.params import Homes
from zengrid.policy.facts import MarketFacts
from zengrid.wire.queries import HomeLimits, JoinReply

_FIELDS = (
    "capacity_kwh", "charge_max_kw", "discharge_max_kw", "soc_min", "soc_max", "charge_efficiency",
    "discharge_efficiency", "injection_max_kw", "soc_initial",
)  # fmt: skip


def market_facts(market: JoinReply, homes: Sequence[HomeLimits]) -> MarketFacts:
    """What a policy for the given homes is told."""
    return MarketFacts(
        dt_h=market.dt_h,
        slots_per_day=market.slots_per_day,
        buy_prices=market.buy_prices,
        sell_prices=market.sell_prices,
        battery_levels=market.battery_levels,
        facilities=market.facilities,
        home_ids=tuple(home.id for home in homes),
        homes=Homes(*(np.array([getattr(home, name) for home in homes], dtype=np.float64) for name in _FIELDS)),
        soc_reset=market.soc_reset,
        scenario=market.scenario,
        pv_kw=tuple(home.pv_kw for home in homes),
    )
