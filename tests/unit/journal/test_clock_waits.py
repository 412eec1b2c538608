"""A market whose journal cannot take a slot waits, says so, and goes on with that slot once it can."""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable

from zengrid.errors import ZengridError
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket

AGENTS = ("p1", "p2", "p3")


def until(condition: Callable[[], bool], missing: str, market: RunningMarket, timeout_s: float = 60.0) -> None:
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"in vain: {missing}\n{market.output()}"
        time.sleep(0.02)


def said(market: RunningMarket, text: str, times: int = 1) -> Callable[[], bool]:
    return lambda: market.processes["clock"].output().count(text) >= times


def answers(market: RunningMarket) -> bool:
    try:
        return market.client.control("status").state == "paused"
    except ZengridError:
        return False


def goes_on_and_is_sound(market: RunningMarket, place: str) -> None:
    """Whoever was told of a slot was told what the journal holds."""
    before = market.last
    assert before is not None
    market.wait_for_slots(50)
    market.client.control("stop")
    assert market.processes["clock"].end() == 0
    with Journal.open(place, read_only=True) as journal:
        run = journal.run()
        assert audit(run) == []
        # Where old days are deleted, the slot told before may be gone with its day.
        for told in (before, market.wait_for_slot(run.kept_from())):
            if told.position >= run.kept_from():
                (kept,) = run.records(told.position, told.position + 1)
                assert (kept.buy_price, kept.demand_kw) == (told.buy_price, told.demand_kw)


def test_a_full_disk_stops_the_market_until_there_is_space() -> None:
    with RunningMarket() as market:
        market.start_agents(*AGENTS)
        market.wait_for_slots(30)
        clock = market.processes["clock"].popen.pid
        _, most = resource.prlimit(clock, resource.RLIMIT_FSIZE)
        # No file of the clock may grow: to SQLite the same as a disk without space.
        size = max(path.stat().st_size for path in market.folder.glob("journal.db*"))
        resource.prlimit(clock, resource.RLIMIT_FSIZE, (size, most))
        until(said(market, "waiting: journal"), "the clock's word", market)
        held = market.client.control("status", homes=False)
        assert held.state == "running"
        assert market.client.control("status", homes=False).totals.slots == held.totals.slots
        # The grid agent may have heard of the slot that waits, and answered: nobody else has.
        told = market.client.latest()
        assert told is not None
        with Journal.open(market.journal, read_only=True) as journal:
            assert journal.run().count() == told.position + 1 == held.totals.slots
        resource.prlimit(clock, resource.RLIMIT_FSIZE, (most, most))
        until(said(market, "going on: slot"), "its going on", market)
        goes_on_and_is_sound(market, str(market.journal))


def test_a_market_that_waits_for_its_journal_can_be_ended() -> None:
    with RunningMarket() as market:
        market.start_agents(*AGENTS)
        market.wait_for_slots(30)
        away = market.journal.rename(market.journal.with_name("away.db"))
        until(said(market, "waiting: journal"), "the clock's word", market)
        market.processes["clock"].signal(signal.SIGTERM)
        assert market.processes["clock"].end() == 1
        assert "can be committed again when this is fixed" in market.processes["clock"].output().splitlines()[-1]
        away.rename(market.journal)
        market.start_clock("--resume")
        market.wait_for_slots(1, timeout_s=30)
        goes_on_and_is_sound(market, str(market.journal))


def test_readers_of_other_processes_leave_the_clock_alone() -> None:
    with RunningMarket() as market:
        market.start_agents(*AGENTS)
        market.wait_for_slots(5)
        for _ in range(20):
            with Journal.open(market.journal, read_only=True) as journal:
                assert journal.run().last() is not None
        goes_on_and_is_sound(market, str(market.journal))


def test_old_days_go_while_the_market_runs() -> None:
    with RunningMarket(options=("--keep-days", "2")) as market:
        market.start_agents(*AGENTS)
        market.wait_for_slot(24 * 6)
        market.client.control("pause")

        def pruned() -> bool:
            with Journal.open(market.journal, read_only=True) as journal:
                run = journal.run()
                last = run.last()
                first = run.records(limit=1)  # none, if it was pruned this very moment
                return last is not None and bool(first) and first[0].day >= last.day - 2

        until(pruned, "old days gone", market)
        status = market.wait_for_status(lambda now: now.state == "paused", missing="the pause")
        assert status.totals.slots >= 24 * 6
        market.processes["clock"].kill()
        market.start_clock("--resume", "--paused")
        until(lambda: answers(market), "the clock's second life", market)
        again = market.client.control("status")
        assert again.totals.slots == status.totals.slots
        assert abs(again.totals.profit - status.totals.profit) < 1e-6
        assert again.homes is not None
        assert status.homes is not None
        assert abs(again.homes.bill - status.homes.bill).max() < 1e-9
        market.client.control("resume")
        goes_on_and_is_sound(market, str(market.journal))
