"""What a policy is told about a market that is played here, without a clock."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zengrid.policy.facts import MarketFacts
from zengrid.scenario import Scenario


def market_facts(scenario: Scenario, homes: Sequence[str] = ()) -> MarketFacts:
    """The part of a scenario that the agent of some homes knows; without homes, the grid agent."""
    places = [scenario.home_ids.index(home) for home in homes]
    return MarketFacts(
        dt_h=scenario.dt_h,
        slots_per_day=scenario.slots_per_day,
        buy_prices=scenario.buy_prices,
        sell_prices=scenario.sell_prices,
        baseline_buy_price=scenario.baseline_buy_price,
        battery_levels=scenario.battery_levels,
        facilities=len(scenario.facilities),
        home_ids=tuple(homes),
        homes=scenario.market().homes.take(np.array(places, dtype=np.intp)),
        soc_reset=scenario.soc_reset,
        scenario=scenario.name,
        pv_kw=tuple(scenario.homes[place].pv_kw for place in places),
    )
