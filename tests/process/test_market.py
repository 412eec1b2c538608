"""The live market with real processes over real Zenoh: what is settled, who takes part, how it is steered."""

from __future__ import annotations

import json
import threading

import numpy as np
import pytest

from support.manual_agent import playing_p1
from zengrid.bus.agent_link import AgentLink, ReceivedObservation
from zengrid.errors import RefusedError
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket
from zengrid.wire.codec import JSON, decode, encode
from zengrid.wire.queries import JoinRequest
from zengrid.wire.slots import FleetAction, FleetObservation

PAPER = ("p1", "p2", "p3")


def test_a_market_runs_to_its_end_and_all_agents_leave() -> None:
    with RunningMarket("paper", ("--days", "3")) as market:
        market.start_agents(*PAPER)
        assert market.processes["clock"].end() == 0, market.output()
        assert [market.processes[name].end() for name in ("grid", *PAPER)] == [0, 0, 0, 0], market.output()
        with Journal.open(market.journal, read_only=True) as journal:
            run = journal.run()
            assert run.info.finished_at is not None
            assert run.count() == 72
            assert audit(run) == []
            assert not any(record.fallback.any() or record.grid_fallback for record in run.records())


def test_a_home_joins_from_another_terminal_and_leaves_again() -> None:
    with RunningMarket("paper") as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(5)
        p4 = market.start_prosumer("p4", "--pv", "5", "--battery", "10")
        market.wait_for_slot(lambda slot: slot.homes == 4 and "p4" in slot.acted, missing="a slot in which p4 acted")
        status = market.client.control("status")
        assert status.homes is not None
        assert status.homes.homes == (*PAPER, "p4")
        assert status.homes.capacity_kwh[3] == 10
        p4.signal(15)
        assert p4.end() == 0, p4.output()
        market.wait_for_slot(lambda slot: slot.homes == 3, missing="a slot without p4")
        market.client.control("stop")
        market.processes["clock"].end()
        with Journal.open(market.journal, read_only=True) as journal:
            assert audit(journal.run()) == []
            assert [len(roster.homes) for _, roster in journal.run().rosters()][-1] == 3


def test_pause_step_speed_and_stop() -> None:
    with RunningMarket("paper", ("--paused",)) as market:
        market.start_agents(*PAPER)
        status = market.wait_for_status(lambda s: s.state == "paused", missing="the pause before the first slot")
        assert (status.day, status.slot, status.last) == (0, 0, None)
        market.client.control("step", slots=5)
        status = market.wait_for_status(lambda s: s.state == "paused" and s.slot == 5, missing="five steps")
        assert status.totals.slots == 5
        market.client.control("speed", speed=3600 * 20)
        market.client.control("resume")
        assert market.wait_for_slot(8).position >= 8
        market.client.control("stop")
        assert market.processes["clock"].end() == 0
        with pytest.raises(Exception, match="nobody answered"):
            market.client.control("status")


def test_the_market_stands_still_once_a_pause_is_confirmed() -> None:
    with RunningMarket() as market:
        market.start_agents(*PAPER)
        for _ in range(20):
            market.wait_for_slots(3)
            told = market.client.control("pause")
            assert (told.state, told.last and told.last.position) == ("paused", told.totals.slots - 1)
            with Journal.open(market.journal, read_only=True) as journal:
                assert journal.run().count() == told.totals.slots
            again = market.client.control("status")
            assert (again.day, again.slot, again.totals) == (told.day, told.slot, told.totals)
            market.client.control("resume")


def test_a_command_waits_for_the_slot_to_end_but_its_answer_not_for_ever() -> None:
    with RunningMarket("paper", ("--paused", "--deadline", "30")) as market, playing_p1(market) as hand:
        market.client.control("step")
        for slot in range(4):
            hand.wait_for_observation()
            if slot == 0:
                # The market waits for p1: the operator is answered, and the three slots count after this one.
                assert market.client.control("step", slots=3).state == "running"
            hand.command(slot, 0.0)
        status = market.wait_for_status(lambda status: status.state == "paused", missing="the pause")
        assert status.totals.slots == 4


def test_any_zenoh_tool_can_read_the_price() -> None:
    with RunningMarket("paper", ("--days", "1", "--speed", "36000x")) as market:
        market.start_agents(*PAPER)
        market.wait_for_slot(3)
        (reply,) = market.client.session.get(market.client.keys.slot)
        assert reply.ok is not None
        slot = json.loads(reply.ok.payload.to_string())
        assert slot["buy_price"] == 0.05
        assert slot["sell_price"] in (0.05, 0.095)


def test_an_agent_can_answer_on_zenohs_own_thread() -> None:
    with RunningMarket("paper", ("--days", "1", "--deadline", "20")) as market:
        market.start_agents("p2", "p3")
        over = threading.Event()
        # What Python keeps for a thread is lost where its state is made anew for every call.
        kept = threading.local()
        threads = set()
        with AgentLink("p1", market.run, market.endpoint) as link:

            def answer(arrival: ReceivedObservation) -> None:
                seen = decode(FleetObservation, arrival.payload, arrival.encoding)
                if seen.phase == "end":
                    over.set()
                    return
                kept.answers = getattr(kept, "answers", 0) + 1
                threads.add((threading.get_ident(), kept.answers == seen.slot + 1))
                link.act(
                    encode(FleetAction(run=seen.run, day=seen.day, slot=seen.slot, instance=me, battery_kw=[0.5])), JSON
                )

            me = "0123456789abcdef"
            link.join(JoinRequest(agent="p1", role="prosumer", instance=me))
            link.ready(answer)
            assert over.wait(60)
        assert market.processes["clock"].end() == 0
        ((thread, counted),) = threads
        assert thread != threading.get_ident()
        assert counted
        records = Journal.open(market.journal, read_only=True).run().records()
        assert len(records) == 24
        assert not any(record.fallback[0] for record in records)
        assert records[0].battery_kw[0] == 0.5


def test_history_is_what_the_journal_holds() -> None:
    with RunningMarket("paper", ("--days", "2")) as market:
        market.start_agents(*PAPER)
        market.wait_for_slot(30)
        first = market.client.history(0, 10, homes=True)
        assert [slot.position for slot in first.slots] == list(range(10))
        assert first.next == 10
        assert [slot.position for slot in market.client.history(first.next, 5).slots] == list(range(10, 15))
        with Journal.open(market.journal, read_only=True) as journal:
            records = journal.run().records(0, limit=10)
        for slot, record in zip(first.slots, records, strict=True):
            assert slot.detail is not None
            assert np.array_equal(slot.detail.soc, record.soc)
            assert slot.profit == record.profit


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--pv", "-1"), 2, "--pv = -1: permitted: a number from 0 kW up"),
        (("--home", '{"id": "p9", "pv_kw": -1}'), 1, "home p9: pv_kw = -1: Input should be greater than or equal to 0"),
        (("--battery", "10", "--load", "no-such-profile"), 1, "no-such-profile"),
        ((), 1, "agent = p9: not in the scenario, so it must bring homes"),
    ],
)
def test_a_home_that_does_not_fit_is_refused_with_its_reason(options: tuple[str, ...], code: int, says: str) -> None:
    with RunningMarket("paper") as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(1)
        stranger = market.start_prosumer("p9", *options)
        assert stranger.end() == code
        assert says in stranger.output()
        assert "Traceback" not in stranger.output()
        market.wait_for_slots(5)


def test_only_the_clock_and_the_grid_have_their_names() -> None:
    with RunningMarket("paper") as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(1)
        for name in ("grid", "clock"):
            stranger = market.start_prosumer(name, "--pv", "1", "--battery", "1", name=f"false-{name}")
            assert stranger.end() == 1
            assert "only the grid agent is called grid" in stranger.output()
        market.wait_for_slots(5)


def test_control_requests_that_make_no_sense_are_refused() -> None:
    with RunningMarket("paper", ("--paused",)) as market:
        market.start_agents(*PAPER)
        with pytest.raises(RefusedError, match="speed: needs a number"):
            market.client.control("speed")
