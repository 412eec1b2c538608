"""Whatever agents, strangers and the clock suffer: the market goes on within one deadline, and nothing is lost."""

from __future__ import annotations

import fcntl
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support.manual_agent import playing_p1
from zengrid.bus.zenoh_session import open_client
from zengrid.journal import Journal, RunView
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket
from zengrid.wire.codec import JSON, encode, encode_fields
from zengrid.wire.queries import Status
from zengrid.wire.slots import GridAction, PublicSlot

PAPER = ("p1", "p2", "p3")
DEADLINE_S = 0.5
SLACK_S = 1.5
"""What a busy test machine may add to a deadline."""


@pytest.fixture
def market() -> Iterator[RunningMarket]:
    with RunningMarket("paper", ("--deadline", str(DEADLINE_S))) as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(5)
        yield market


def settled(market: RunningMarket) -> RunView:
    """End the market; its journal must be without fault."""
    market.client.control("stop")
    assert market.processes["clock"].end() == 0
    run = Journal.open(market.journal, read_only=True).run()
    assert audit(run) == []
    return run


def longest_gap_s(run: RunView) -> float:
    """Longest time between two settled slots."""
    times = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
    return float(np.diff(times).max())


def without(agent: str, market: RunningMarket) -> PublicSlot:
    """Wait for a slot in which all but one agent acted."""
    rest = {"grid", *PAPER} - {agent}
    return market.wait_for_slot(
        lambda slot: agent in slot.fallback and rest <= set(slot.acted), missing=f"a slot without {agent}"
    )


@pytest.mark.parametrize("agent", ["p2", "grid"])
def test_a_killed_agent_is_given_up_at_once(market: RunningMarket, agent: str) -> None:
    market.processes[agent].kill()
    without(agent, market)
    market.wait_for_slots(20)
    status = market.client.control("status")
    presence = {a.id: (a.presence, a.last_cause) for a in status.agents}
    assert presence[agent] == ("away", "away")
    assert longest_gap_s(settled(market)) < DEADLINE_S + SLACK_S


def test_an_agent_that_was_killed_comes_back(market: RunningMarket) -> None:
    market.processes["p1"].kill()
    without("p1", market)
    market.start_prosumer("p1")
    market.wait_for_slot(lambda slot: "p1" in slot.acted, missing="p1 back")
    settled(market)


@pytest.mark.parametrize("agent", ["p3", "grid"])
def test_a_stopped_agent_costs_deadlines_then_nothing_and_returns(market: RunningMarket, agent: str) -> None:
    market.processes[agent].signal(signal.SIGSTOP)
    market.wait_for_status(
        lambda s: next(a for a in s.agents if a.id == agent).presence != "present", missing=f"{agent} given up"
    )
    start = market.wait_for_slots(1)
    began = time.monotonic()
    market.wait_for_slot(start.position + 50)
    assert time.monotonic() - began < 50 * DEADLINE_S / 2, "the market still waits for a stopped agent"
    market.processes[agent].signal(signal.SIGCONT)
    market.wait_for_slot(lambda slot: agent in slot.acted, missing=f"{agent} back")
    run = settled(market)
    assert longest_gap_s(run) < DEADLINE_S + SLACK_S


def test_a_slot_is_published_while_the_grid_agent_is_slow() -> None:
    with RunningMarket("paper", ("--deadline", "20")) as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(5)
        market.processes["grid"].signal(signal.SIGSTOP)
        seen = [-1]

        def stands_still(status: Status) -> bool:
            seen.append(status.totals.slots)
            return seen[-1] == seen[-2]

        held = market.wait_for_status(stands_still, missing="a market that waits").last
        assert held is not None
        # Before its link is given up, which ends the waiting.
        assert market.wait_for_slot(held.position, timeout_s=SLACK_S).position == held.position


def test_a_hung_program_is_found_by_the_deadline(market: RunningMarket) -> None:
    market.processes["p1"].kill()
    without("p1", market)
    script = Path(__file__).parents[1] / "support" / "hung_agent.py"
    hung = subprocess.Popen([sys.executable, str(script), "p1", market.endpoint, market.run, "10"])
    try:
        market.wait_for_slot(lambda slot: "p1" in slot.acted, missing="the agent before it hangs")
        market.wait_for_status(
            lambda s: next(a for a in s.agents if a.id == "p1").presence == "absent", missing="the hung agent given up"
        )
        market.wait_for_slots(50)
        # It does not keep its place from a healthy process.
        market.start_prosumer("p1", name="p1-again")
        market.wait_for_slot(lambda slot: "p1" in slot.acted, missing="the process that takes over")
    finally:
        hung.kill()
        hung.wait()
    assert longest_gap_s(settled(market)) < DEADLINE_S + SLACK_S


VIEWER = """
import sys, threading
from zengrid.bus.market_client import MarketClient
with MarketClient(sys.argv[1], sys.argv[2]) as client:
    following = client.follow(lambda slot: print("seen", flush=True))
    threading.Event().wait()
"""


def test_viewers_that_do_not_read_any_more_cost_only_themselves(market: RunningMarket) -> None:
    """More of them than the bus has threads; beyond the time after which Zenoh gives up their links."""
    command = [sys.executable, "-c", VIEWER, market.run, market.endpoint]
    viewers = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(4)]
    try:
        for viewer in viewers:
            assert viewer.stdout is not None
            assert viewer.stdout.readline() == b"seen\n"
            viewer.send_signal(signal.SIGSTOP)
        until = time.monotonic() + 8
        while time.monotonic() < until:
            market.wait_for_slots(20, timeout_s=10)
        assert market.client.control("status").state == "running"
    finally:
        for viewer in viewers:
            viewer.kill()
            viewer.communicate()
    run = settled(market)
    assert longest_gap_s(run) < DEADLINE_S + SLACK_S
    assert not any(block["fallback"].any() for block in run.blocks())


def test_the_clock_keeps_its_locks_on_the_journal(market: RunningMarket) -> None:
    # Each link that came had the clock look at all that it has open. Without this lock the next reader would cut the
    # index of SQLite's log (its byte 128 says that the index is in use) under the clock's feet.
    with Path(f"{market.journal}-shm").open("r+b") as index, pytest.raises(BlockingIOError):
        fcntl.lockf(index, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, 128)
    for _ in range(20):
        with Journal.open(market.journal, read_only=True) as journal:
            assert journal.run().count() > 0
    market.wait_for_slots(5)


def test_a_second_process_of_the_same_name_is_refused(market: RunningMarket) -> None:
    second = market.start_prosumer("p1", name="second")
    assert second.end() == 1
    assert "agent = p1: another process plays it" in second.output()
    market.wait_for_slot(lambda slot: set(PAPER) <= set(slot.acted), missing="a slot of everyone")
    settled(market)


def test_messages_that_do_not_count_are_refused_by_cause_and_change_nothing(market: RunningMarket) -> None:
    """Against a market of the same agents that nobody disturbs: every settlement is the same, to the last bit."""
    with open_client(market.endpoint) as session:
        latest = market.client.latest()
        assert latest is not None

        def action(**changes: object) -> bytes:
            day = latest.day + 1_000_000
            fields: dict[str, object] = {"v": 1, "run": market.run, "day": day, "slot": 0, "phase": "battery"}
            fields |= {"instance": "0123456789abcdef", "battery_kw": np.array([2.0]), **changes}
            return encode_fields(fields)

        bad: dict[str, tuple[str, bytes]] = {
            "malformed": ("p1", b"{not json"),
            "oversized": ("p1", b"x" * 100_000),
            "foreign": ("p2", action()),
            "wrong_run": ("p3", action(run="other")),
            "unknown_agent": ("p99", action()),
        }
        for cause, (agent, payload) in bad.items():
            before = market.client.control("status").refused.get(cause, 0)
            # Between observation and answer is the only time at which it could count: try until it was looked at there.
            until = time.monotonic() + 20
            while market.client.control("status").refused.get(cause, 0) == before:
                assert time.monotonic() < until, f"{cause} was never counted: {market.client.control('status').refused}"
                for _ in range(20):
                    session.put(market.client.keys.action(agent), payload, encoding=JSON)
        market.wait_for_slot(60)
    disturbed = settled(market).records(limit=60)
    with RunningMarket("paper", ("--days", "3")) as quiet:
        quiet.start_agents(*PAPER)
        assert quiet.processes["clock"].end() == 0
        undisturbed = Journal.open(quiet.journal, read_only=True).run().records(limit=60)
    for one, other in zip(disturbed, undisturbed, strict=True):
        assert one.bill.tobytes() == other.bill.tobytes()
        assert one.soc.tobytes() == other.soc.tobytes()


def test_late_future_duplicate_and_impossible_actions_are_refused() -> None:
    with RunningMarket("paper", ("--paused", "--deadline", "20")) as market:
        with playing_p1(market) as hand:

            def refused(cause: str) -> None:
                market.wait_for_status(lambda s: s.refused.get(cause, 0) > 0, missing=f"a refusal as {cause}")

            market.client.control("step", slots=2)
            hand.wait_for_observation()
            hand.command(1, 0.0)
            refused("future")
            hand.command(0, 2.5)
            refused("out_of_range")
            hand.command(0, [0.0, 0.0])
            market.wait_for_status(lambda s: s.refused.get("out_of_range", 0) == 2, missing="a refusal of two commands")
            hand.command(0, 1.5)
            hand.wait_for_observation()
            hand.command(0, -2.0)
            refused("late")
            hand.command(1, 0.5)
            hand.command(1, -1.0)
            market.wait_for_slot(1)
        run = settled(market)
        assert [float(record.battery_kw[0]) for record in run.records()] == [1.5, 0.5]


def test_a_foreign_price_does_not_count(market: RunningMarket) -> None:
    with open_client(market.endpoint) as session:
        for _ in range(2000):
            latest = market.last
            assert latest is not None
            forged = GridAction(
                run=market.run, day=latest.day, slot=latest.slot, instance="0123456789abcdef", buy_price=0.1
            )
            session.put(market.client.keys.action("grid"), encode(forged), encoding=JSON)
    market.wait_for_slots(20)
    run = settled(market)
    assert {float(price) for block in run.blocks(homes=False) for price in block["buy_price"]} == {0.05}


def test_the_clock_is_killed_and_goes_on_where_it_was(market: RunningMarket) -> None:
    market.wait_for_slots(30)
    p4 = market.start_prosumer("p4", "--pv", "3", "--battery", "5")
    market.wait_for_slot(lambda slot: "p4" in slot.acted, missing="p4")
    market.processes["clock"].kill()
    with Journal.open(market.journal, read_only=True) as journal:
        kept = journal.run().records(limit=10_000)
    market.start_clock("--resume", "--days", str(kept[-1].day + 3))
    everyone = {"grid", *PAPER, "p4"}
    market.wait_for_slot(
        lambda slot: slot.position > len(kept) and everyone <= set(slot.acted), missing="everyone under the new clock"
    )
    assert market.processes["clock"].end(30) == 0
    assert [market.processes[name].end() for name in ("grid", *PAPER)] == [0, 0, 0, 0], market.output()
    assert p4.end() == 0
    with Journal.open(market.journal, read_only=True) as journal:
        run = journal.run()
        assert audit(run) == []
        again = run.records(limit=len(kept))
        assert [r.bill.tobytes() for r in again] == [r.bill.tobytes() for r in kept]
        assert run.count() == (kept[-1].day + 3) * 24
