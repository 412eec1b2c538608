"""Processes that play whichever home is free: each gets one, none gets another's, and who comes back gets its own."""

from __future__ import annotations

import signal

import pytest

from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket

OWN = ("--pv", "4", "--battery", "8")


@pytest.mark.slow
def test_three_take_the_homes_of_the_scenario_the_fourth_brings_its_own_and_a_restarted_one_is_back() -> None:
    with RunningMarket("paper") as market:
        market.start_agents()
        started = [market.start_prosumer("auto", *OWN, name=f"first{i}") for i in range(4)]
        slot = market.wait_for_slot(lambda s: len(s.acted) == 5, timeout_s=60, missing="a slot in which all four acted")
        own = next(name for name in slot.acted if name.startswith("home-"))
        assert set(slot.acted) == {"grid", "p1", "p2", "p3", own}
        assert slot.homes == 4
        for process in started:
            process.signal(signal.SIGKILL)
            process.end()
        market.wait_for_slot(lambda s: s.acted == ("grid",), missing="a slot without any of them")
        again = [market.start_prosumer("auto", *OWN, name=f"again{i}") for i in range(4)]
        slot = market.wait_for_slot(lambda s: len(s.acted) == 5, timeout_s=60, missing="all four again")
        assert set(slot.acted) == {"grid", "p1", "p2", "p3", own}
        # Whose home is the scenario's leaves it in the market; who brought one takes it along.
        for process in again:
            process.signal(signal.SIGTERM)
            assert process.end() == 0, process.output()
        market.wait_for_slot(lambda s: s.homes == 3, missing="a slot without the home that was brought")
        market.client.control("stop")
        assert market.processes["clock"].end() == 0, market.output()
        with Journal.open(market.journal, read_only=True) as journal:
            assert audit(journal.run()) == []
