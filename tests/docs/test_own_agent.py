"""The example of an agent of one's own takes part in a real market, both ways."""

from __future__ import annotations

import signal
import sys

from support.doc_pages import ROOT
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.testing import Process, RunningMarket

EXAMPLE = str(ROOT / "docs" / "examples" / "own_agent.py")


def start(market: RunningMarket, agent: str, *options: str) -> Process:
    return market.start(f"own {agent}", sys.executable, EXAMPLE, agent, *options)


def test_it_plays_a_home_of_the_scenario_and_earns_more_than_without_demand_response() -> None:
    with RunningMarket("paper", ("--days", "2")) as market:
        market.start_grid("--policy", "tou:0.05,19:00=0.10,22:00=0.05")
        for agent in ("p2", "p3"):
            market.start_prosumer(agent)
        mine = start(market, "p1")
        assert market.processes["clock"].end(20) == 0
        assert mine.end() == 0
        with Journal.open(market.journal, read_only=True) as journal:
            run = journal.run()
            assert audit(run) == []
            home = run.home("p1")
            assert not home["fallback"].any()
            assert home["bill"].sum() < home["baseline_bill"].sum()


def test_it_brings_a_home_and_takes_it_out_again() -> None:
    with RunningMarket("paper") as market:
        market.start_agents("p1", "p2", "p3")
        mine = start(market, "p9", "5", "10")
        market.wait_for_slot(lambda slot: slot.homes == 4 and "p9" in slot.acted, missing="a slot in which p9 acted")
        status = market.client.control("status")
        assert status.homes is not None
        assert (status.homes.homes[3], status.homes.capacity_kwh[3], status.homes.pv_rated_kw[3]) == ("p9", 10, 5)
        assert status.refused == {}
        mine.signal(signal.SIGINT)
        assert mine.end() == 0
        market.wait_for_slot(lambda slot: slot.homes == 3, missing="a slot without p9")


def test_it_prints_why_it_was_refused() -> None:
    with RunningMarket("paper") as market:
        market.start_agents("p1", "p2", "p3")
        market.wait_for_slots(1)
        mine = start(market, "p1")
        assert mine.end() == 1
        assert "refused: " in mine.output()
        assert "another process plays it" in mine.output()
