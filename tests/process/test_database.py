"""A market whose PostgreSQL server goes away waits, loses nothing that was settled, and goes on when it is back."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Literal

import pytest

from support.gateway_process import gateway
from support.network_hosts import NetworkHosts, why_not
from support.postgres import BreakableConnection, PostgresServer, postgres_server
from zengrid.errors import JournalUnavailableError
from zengrid.journal import Journal
from zengrid.journal.postgres import SILENT_MS
from zengrid.testing import Process, RunningMarket, free_port
from zengrid.wire.codec import decode
from zengrid.wire.slots import PublicSlot

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

AGENTS = ("p1", "p2", "p3")
PATIENCE_S = 120.0
"""For a server or a clock that has to share the machine."""


@pytest.fixture(scope="module")
def postgres() -> Iterator[PostgresServer]:
    with postgres_server() as server:
        yield server


class Follower:
    """A market that is running with its journal at a URL, and every slot that anybody was told of."""

    def __init__(self, market: RunningMarket) -> None:
        self.market = market
        self.told: list[PublicSlot] = []
        market.start_agents(*AGENTS)
        self._following = market.client.follow(lambda payload: self.told.append(decode(PublicSlot, payload)))
        market.wait_for_slot(lambda slot: {"grid", *AGENTS} <= set(slot.acted), PATIENCE_S, "a slot of everyone")
        market.wait_for_slots(30, PATIENCE_S)

    def said(self, text: str, times: int = 1) -> None:
        """Wait until the clock has said something so many times."""
        clock = self.market.processes["clock"]
        until = time.monotonic() + PATIENCE_S
        while clock.output().count(text) < times:
            assert clock.popen.poll() is None, "the clock has ended"
            assert time.monotonic() < until, f"not said: {text}"
            time.sleep(0.02)

    def waits(self, times: int) -> None:
        """The market stands still, says why, and counts it; operators are answered."""
        status = self.market.wait_for_status(
            lambda status: status.journal_wait_s > 0, PATIENCE_S, "a market that waits for its journal"
        )
        assert status.journal_waits == times
        self.said("waiting: journal postgresql://", times)
        again = self.market.client.control("status", homes=False)
        assert again.totals.slots == status.totals.slots

    def goes_on(self, times: int) -> None:
        """The slot that waited is settled, and others follow."""
        self.said("going on: slot", times)
        self.market.wait_for_slots(30, PATIENCE_S)
        status = self.market.client.control("status")
        assert (status.journal_waits, status.journal_wait_s) == (times, 0.0)

    def ends_soundly(self, url: str, *, cut_off: bool = False) -> None:
        """Every slot is in the journal once, and is what everybody was told; who was cut off was not told of all."""
        self.market.client.control("stop")
        assert self.market.processes["clock"].end(PATIENCE_S) == 0
        verify(url)
        with Journal.open(url, read_only=True) as journal:
            (info,) = journal.runs()
            (count,) = {journal.run().count(), info.slots}
            kept: list[tuple[int, float, float]] = []
            for block in journal.run().blocks(homes=False):
                kept += zip(*(block[name].tolist() for name in ("position", "buy_price", "demand_kw")), strict=True)
        until = time.monotonic() + PATIENCE_S
        while self.told[-1].position < count - 1:
            assert time.monotonic() < until, "the last slot was never told"
            time.sleep(0.02)
        told = [(slot.position, slot.buy_price, slot.demand_kw) for slot in self.told]
        assert [position for position, _, _ in kept] == list(range(count))
        expected = (
            [kept[position] for position in sorted({slot[0] for slot in told})] if cut_off else kept[told[0][0] :]
        )
        assert told == expected


def verify(url: str) -> None:
    """As an operator does."""
    command = [sys.executable, "-m", "zengrid_cli", "journal", "verify", "--journal", url]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout + done.stderr


def market_at(url: str, *options: str) -> RunningMarket:
    return RunningMarket("paper", ("--journal", url, *options))


def test_a_market_waits_while_its_database_is_stopped(postgres: PostgresServer) -> None:
    url = postgres.url(postgres.new_database())
    with market_at(url) as market:
        following = Follower(market)
        modes: tuple[Literal["fast", "immediate"], ...] = ("fast", "immediate", "immediate", "fast")
        for times, mode in enumerate(modes, 1):
            postgres.stop(mode)
            try:
                following.waits(times)
            finally:
                postgres.start()
            following.goes_on(times)
        following.ends_soundly(url)


def test_a_gateway_says_that_the_journal_is_away_and_reads_on_when_it_is_back(postgres: PostgresServer) -> None:
    url = postgres.url(postgres.new_database())
    with market_at(url) as market:
        following = Follower(market)
        with gateway(market, "--journal", url) as page:
            assert page.get("/v1/runs")["runs"]
            postgres.stop()
            try:
                following.waits(1)
                for path in ("/v1/runs", "/v1/history?limit=1", "/v1/runs/test-1/kpis"):
                    assert page.get(path, 503)["type"] == "urn:zengrid:journal-away"
                page.wait(
                    "/metrics", lambda answer: "zengrid_journal_waits_total 1.0" in answer.text, "the wait counted"
                )
                assert page.get("/v1/price")["run"] == "test"
            finally:
                postgres.start()
            following.goes_on(1)
            assert page.get("/v1/history?limit=1")["rows"]
        following.ends_soundly(url)


def test_a_slot_that_was_committed_without_an_answer_is_settled_once(postgres: PostgresServer) -> None:
    name = postgres.new_database()
    with BreakableConnection(postgres) as line, market_at(postgres.url(name, line.folder)) as market:
        following = Follower(market)
        for times in range(1, 6):
            line.cut.clear()
            line.cut_before_the_answer()
            assert line.cut.wait(PATIENCE_S)
            # The server holds the connection for alive, and with it the right to write: nobody may take that as another
            # clock's.
            following.waits(times)
            following.said("is being written by another process", times)
            committed = slots(postgres.url(name))
            line.mend()
            following.goes_on(times)
            (slot,) = (told for told in following.told if told.position == committed - 1)
            assert slot.acted, "the slot in doubt was played by agents, and told after it was found"
        following.ends_soundly(postgres.url(name))


def test_a_cable_to_the_database_that_is_cut_leaves_the_run_to_others_in_time(postgres: PostgresServer) -> None:
    """Neither side hears that the other is gone: both must give up by themselves, the server the lock as well."""
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    name = postgres.new_database()
    with NetworkHosts("there") as hosts:
        postgres.stop("fast")
        postgres.start(hosts.here)
        hosts.quality("there")
        with Elsewhere(hosts, postgres.url(name, address=hosts.here)) as market:
            following = Follower(market)
            hosts.cut("there")
            began = time.monotonic()
            while not can_be_resumed(postgres.url(name)):
                assert time.monotonic() < began + 2 * SILENT_MS / 1000, "the server holds the lock for who is gone"
                time.sleep(0.2)
            following.said("waiting: journal postgresql://", 1)
            hosts.quality("there")
            following.goes_on(1)
            following.ends_soundly(postgres.url(name), cut_off=True)


class Elsewhere(RunningMarket):
    """A market on another host, with its journal at a URL."""

    def __init__(self, hosts: NetworkHosts, url: str) -> None:
        super().__init__("paper", ("--journal", url, "--insecure"))
        self.endpoint = f"tcp/{hosts.address('there')}:{free_port()}"
        self._hosts = hosts

    def start(self, name: str, *command: str) -> Process:
        return super().start(name, *self._hosts.on("there", *command))


def can_be_resumed(url: str) -> bool:
    """Whether nobody writes the run."""
    with Journal.open(url) as journal:
        try:
            journal.resume()
        except JournalUnavailableError:
            return False
        return True


def slots(url: str) -> int:
    """How many are in the journal."""
    with Journal.open(url, read_only=True) as journal:
        return journal.run().count()


def test_a_database_that_stays_away_ends_the_clock_which_can_be_resumed(postgres: PostgresServer) -> None:
    url = postgres.url(postgres.new_database())
    with market_at(url, "--journal-wait", "1") as market:
        following = Follower(market)
        clock = market.processes["clock"]
        postgres.stop()
        try:
            assert clock.end(PATIENCE_S) == 1
            last = clock.output().splitlines()[-1]
            assert "given up after 1 s" in last
            assert "can be committed again when this is fixed" in last
            # While it is away nothing begins, and that is said, too.
            assert market.start_clock("--resume").end(PATIENCE_S) == 1
            assert "cannot be opened" in market.processes["clock"].output()
        finally:
            postgres.start()
        told = following.told[-1].position
        # The server may have ended between a commit and its answer: then it holds one slot more than anybody heard of.
        held = slots(url)
        assert held in (told + 1, told + 2)
        del following.told[:]
        market.start_clock("--resume")
        market.wait_for_slot(held + 30, PATIENCE_S)
        assert following.told[0].position == held
        following.ends_soundly(url)
