"""Whatever a process with an agent's name sends, the clock refuses and counts it, and the market keeps its pace."""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from support.certificate_folders import make_certs
from zengrid.bus.agent_link import AgentLink
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import KeyExpressions
from zengrid.bus.zenoh_session import open_client
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.testing import RunningMarket
from zengrid.wire.codec import BINARY, JSON, decode, encode
from zengrid.wire.queries import JoinRequest, Refusal

PAPER = ("p1", "p2", "p3")
DEADLINE_S = 0.5
SLACK_S = 1.5
"""What a busy test machine may add to a deadline."""
ATTEMPTS = 100


@pytest.fixture(
    scope="module",
    params=["open", pytest.param("certificates", marks=[pytest.mark.slow, pytest.mark.timeout(300)])],
)
def market(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningMarket]:
    certs = make_certs(tmp_path_factory.mktemp("certs")) if request.param == "certificates" else None
    options = ("--deadline", str(DEADLINE_S), "--max-homes", "4000")
    with RunningMarket("paper", options, certs=certs) as market:
        market.start_agents(*PAPER)
        market.wait_for_slot(lambda slot: {"grid", *PAPER} <= set(slot.acted), missing="a slot of everyone")
        yield market
        market.client.control("stop")
        assert market.processes["clock"].end() == 0
        with Journal.open(market.journal, read_only=True) as journal:
            run = journal.run()
            assert audit(run) == []
            times = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
        assert float(np.diff(times).max()) < DEADLINE_S + SLACK_S, "the market was held up"


def session_of(market: RunningMarket, agent: str) -> zenoh.Session:
    credentials = None if market.certs is None else Credentials(market.certs, agent)
    return open_client(market.endpoint, credentials=credentials, timeout_s=20.0)


def refusals(market: RunningMarket) -> dict[str, int]:
    return market.client.control("status", homes=False).refused


NESTED = b"[" * 50_000
MALFORMED: list[tuple[str, bytes]] = [
    (BINARY, b"\xff" * 8 + b'{"__metadata__":{"message":"{}"}}'),
    (BINARY, b"\x00" * 8),
    (BINARY, b"\x02\0\0\0\0\0\0\0[]"),
    (BINARY, b'\x1f\0\0\0\0\0\0\0{"__metadata__":{"message":"[]"}}'),
    (BINARY, b""),
    (JSON, b'{"\xff":0}'),
    (JSON, NESTED[:900]),
    (JSON, b'{"v":1,"battery_kw":[1e999]}'),
    (JSON, b""),
    ("text/plain;" + "x" * 100, b"\x00"),
]


@pytest.mark.parametrize("agent", ["p1", "grid"])
def test_bytes_that_no_message_has_are_refused_and_counted(market: RunningMarket, agent: str) -> None:
    before = refusals(market)

    def counted() -> int:
        # One that comes after the agent has answered is not even read.
        refused = refusals(market)
        return sum(refused.get(cause, 0) - before.get(cause, 0) for cause in ("malformed", "duplicate", "late"))

    with session_of(market, agent) as session:
        until = time.monotonic() + 60
        sent = 0
        while counted() < ATTEMPTS:
            assert time.monotonic() < until, f"{counted()} refusals of {sent}, after {before}: {refusals(market)}"
            # With certificates Zenoh drops what comes too soon after the one before: some are sent again.
            for encoding, payload in MALFORMED if sent < ATTEMPTS or market.certs is not None else ():
                session.put(
                    market.client.keys.action(agent), payload, encoding=encoding,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                )  # fmt: skip
                sent += 1
    if market.certs is None:
        assert counted() == sent == ATTEMPTS
    assert refusals(market).get("internal", 0) == 0
    market.wait_for_slot(lambda slot: {"grid", *PAPER} <= set(slot.acted), missing="a slot of everyone")


def home(name: str, **battery: float) -> dict[str, Any]:
    return {"id": name, "pv_kw": 3, "battery": {"capacity_kwh": 5, **battery}}


def joins(agent: str, homes: list[dict[str, Any]]) -> bytes:
    fields = {"v": 1, "agent": agent, "role": "prosumer", "instance": secrets.token_hex(8), "homes": homes}
    return json.dumps(fields).encode()


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (lambda: joins("p4", [home("p4", capacity_kwh=1e-320)]), "invalid"),
        (lambda: joins("p4", [home("p4", charge_max_kw=1e-320)]), "invalid"),
        (lambda: joins("p4", [home("p4", discharge_efficiency=5e-324)]), "invalid"),
        (lambda: joins("p4", [*(home(f"x{i}") for i in range(3000)), home("p1")]), "taken"),
        (lambda: joins("p4", [home(f"x{i}") for i in range(20_000)]), "full"),
        (lambda: joins("p4", [home("p4")] * 3000), "taken"),
        (lambda: b'{"homes":[' + b"0," * 100_000 + b"0]}", "invalid"),
        (lambda: b'{"homes":' + NESTED, "invalid"),
        (lambda: b"\xff\xfe", "invalid"),
    ],
)  # fmt: skip
def test_impossible_joins_are_refused_at_once(market: RunningMarket, payload: Callable[[], bytes], reason: str) -> None:
    """The market's longest gap between two slots, looked at in the end, says what they have cost."""
    # A name of its own for each, so that none is refused for asking too often; with certificates there are few names.
    agent = "p4" if market.certs is not None else f"x{secrets.token_hex(4)}"
    message = payload().replace(b'"agent": "p4"', b'"agent": "%b"' % agent.encode())
    with session_of(market, agent) as session:
        answers: list[zenoh.Reply] = []
        until = time.monotonic() + 30
        while not answers and time.monotonic() < until:
            answers = list(
                session.get(KeyExpressions(market.run).join(agent), payload=message, encoding=JSON, timeout=5.0)
            )
    assert answers, "no answer"
    (answer,) = answers
    assert answer.err is not None
    refusal = decode(Refusal, answer.err.payload.to_bytes())
    assert refusal.reason == reason, refusal
    assert len(refusal.message) < 500
    market.wait_for_slots(3)


def test_a_silent_agent_that_joins_again_and_again_is_not_waited_for(market: RunningMarket) -> None:
    """It would else reset the count of its missed deadlines with each join."""
    agent, instance = "p5", secrets.token_hex(8)
    request = JoinRequest.model_validate_json(joins(agent, [home(agent)])).model_copy(update={"instance": instance})

    def presence(status: Any) -> str:
        return next((each.presence for each in status.agents if each.id == agent), "away")

    before = refusals(market).get("join_unavailable", 0)
    with AgentLink(agent, market.run, market.endpoint, certs=market.certs) as link:
        link.join(request)
        link.ready()
        market.wait_for_status(lambda status: presence(status) == "absent", missing="the silent agent given up")
        ended = threading.Event()

        def join_again() -> None:
            with session_of(market, agent) as session:
                while not ended.is_set():
                    session.get(market.client.keys.join(agent), payload=encode(request), encoding=JSON, timeout=0.2)
                    ended.wait(0.05)

        joining = threading.Thread(target=join_again)
        joining.start()
        try:
            market.wait_for_status(
                lambda status: status.refused.get("join_unavailable", 0) >= before + 10,
                missing="refusals to join again",
            )
            start = market.wait_for_slots(1).position
            began = time.monotonic()
            market.wait_for_slot(start + 50)
            assert time.monotonic() - began < 50 * DEADLINE_S / 2, "the market waits for it again"
            assert presence(market.client.control("status")) == "absent"
        finally:
            ended.set()
            joining.join()
        link.leave(instance)
    market.wait_for_slot(lambda slot: slot.homes == len(PAPER), missing="a slot without the silent agent")


def test_joining_again_as_before_writes_no_roster(market: RunningMarket) -> None:
    agent = "p6" if market.certs is None else "p4"
    homes = [home(agent), *(home(f"{agent}-{i}") for i in range(200))]
    request = JoinRequest.model_validate_json(joins(agent, homes))

    def rosters() -> int:
        with Journal.open(market.journal, read_only=True) as journal:
            return len(journal.run().rosters())

    with AgentLink(agent, market.run, market.endpoint, certs=market.certs) as link:
        link.join(request)
        link.ready()
        market.wait_for_slot(lambda slot: slot.homes == len(PAPER) + len(homes), missing="a slot with its homes")
        market.wait_for_slots(2)
        known = rosters()
        for _ in range(5):
            link.join(request)
            market.wait_for_slots(1)
        assert rosters() == known
        link.leave(request.instance)
    market.wait_for_slot(lambda slot: slot.homes == len(PAPER), missing="a slot without them")


def test_the_journal_of_an_attacked_market_is_resumed(tmp_path: Path) -> None:
    """A battery of 1e-320 kWh once made the clock spin for ever after a restart."""
    with RunningMarket("paper", ("--deadline", str(DEADLINE_S))) as market:
        market.start_agents(*PAPER)
        market.wait_for_slots(5)
        with session_of(market, "p4") as session:
            payload = joins("p4", [home("p4", capacity_kwh=1e-320)])
            (answer,) = session.get(market.client.keys.join("p4"), payload=payload, encoding=JSON, timeout=10.0)
            assert answer.err is not None
        market.processes["clock"].kill()
        market.start_clock("--resume")
        market.wait_for_slots(5)
        market.client.control("stop")
        assert market.processes["clock"].end() == 0
