"""The baseline without demand response, settled ahead for many slots, is what slot after slot would have given."""

from __future__ import annotations

import numpy as np
import pytest

from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.scenario import Days, load
from zengrid.scenario.home_spec import HomeSpec
from zengrid_clock.live_market import LiveMarket
from zengrid_clock.profiles_ahead import DAYS_AHEAD

DAYS = DAYS_AHEAD + 2
JOINS, LEAVES = (1, 5), (3, 9)
GUEST = HomeSpec.model_validate({"id": "guest", "pv_kw": 5.0, "battery": {"capacity_kwh": 8.0}})


@pytest.mark.parametrize("soc_reset", ["daily", "never"])
@pytest.mark.parametrize("guest", [False, True])
def test_the_baseline_is_the_same_to_the_last_bit(soc_reset: str, *, guest: bool) -> None:
    scenario = load("paper").with_(soc_reset=soc_reset)
    market = LiveMarket(scenario, Days(scenario))
    price = np.asarray(scenario.baseline_buy_price)
    soc = market.params.homes.soc_initial.copy()
    for day in range(DAYS):
        market.begin_day(day)
        if soc_reset == "daily":
            soc = market.params.homes.soc_initial.copy()
        for slot in range(scenario.slots_per_day):
            if guest and (day, slot) == JOINS:
                market.add("guest", [GUEST])
                soc = np.append(soc, market.params.homes.soc_initial[-1])
            if guest and (day, slot) == LEAVES:
                market.remove("guest")
                soc = soc[:-1]
            exogenous = market.profile(slot)
            command = conventional(exogenous.pv_kw, exogenous.load_kw, market.params.homes)
            expected = settle(soc, Action(price, command), exogenous, market.params)
            baseline = market.baseline(slot)
            for name, value in baseline._asdict().items():
                assert np.asarray(value).tobytes() == np.asarray(getattr(expected, name)).tobytes(), (day, slot, name)
            # What the agents do, the baseline does not notice.
            done = market.settle(market.prepare(exogenous), Action(price, np.zeros(len(market.homes))))
            market.advance(done, baseline)
            soc = expected.soc
