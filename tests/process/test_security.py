"""A market with certificates, and agents that try what they may not: nothing leaks, nobody is wrongly paid, it goes on.

What Zenoh's access list stops is stopped without a word and never reaches the clock: there the test is that nothing
comes of it. What reaches the clock is counted by cause.
"""

from __future__ import annotations

import json
import secrets
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh

from support.certificate_folders import make_certs
from support.gateway_process import gateway, start_spawner
from zengrid.bus.agent_link import AgentLink
from zengrid.bus.certificates import Authority
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import ROOT, KeyExpressions
from zengrid.bus.market_client import MarketClient
from zengrid.bus.zenoh_session import open_client
from zengrid.errors import BusError, SecurityError
from zengrid.journal import Journal
from zengrid.journal.audit import audit
from zengrid.scenario.home_spec import HomeSpec
from zengrid.testing import RunningMarket
from zengrid.wire.base import Message
from zengrid.wire.codec import JSON, decode, encode
from zengrid.wire.queries import ControlRequest, HistoryRequest, JoinRequest, LeaveRequest, Refusal, ScenarioRequest
from zengrid.wire.slots import FleetAction, FleetObservation, GridAction

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]  # many attackers, and a machine that may be busy

DEADLINE_S = 0.5
SLACK_S = 1.5
"""What a busy test machine may add to a deadline."""
PAPER = ("p1", "p2", "p3")
REMOTE = zenoh.Locality.REMOTE
"""A session hears its own messages without any network; they say nothing."""


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_certs(tmp_path_factory.mktemp("certs"))


@pytest.fixture(scope="module")
def market(certs: Path) -> Iterator[RunningMarket]:
    with RunningMarket("paper", ("--deadline", str(DEADLINE_S)), certs=certs) as market:
        market.start_agents(*PAPER)
        market.wait_for_slot(lambda slot: {"grid", *PAPER} <= set(slot.acted), missing="a slot of everyone")
        yield market
        check_books(market)


def check_books(market: RunningMarket) -> None:
    """The honest have played the conventional rule at the lowest price, so each bill must be as without attacks."""
    market.client.control("stop")
    assert market.processes["clock"].end() == 0
    with Journal.open(market.journal, read_only=True) as journal:
        run = journal.run()
        assert audit(run) == []
        for block in run.blocks():
            assert set(block["buy_price"].tolist()) == {0.05}
            honest = [block.roster.homes.index(name) for name in PAPER]
            assert block["bill"][:, honest].tobytes() == block["baseline_bill"][:, honest].tobytes()
        times = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
        assert float(np.diff(times).max()) < DEADLINE_S + SLACK_S, "the market was held up"


def session_of(market: RunningMarket, name: str, certs: Path | None = None) -> zenoh.Session:
    folder = certs or market.certs
    assert folder is not None
    return open_client(market.endpoint, credentials=Credentials(folder, name), timeout_s=20.0)


def ask(session: zenoh.Session, key: str, message: Message) -> list[zenoh.Reply]:
    """All answers to a question; it is not asked twice."""
    return list(session.get(key, payload=encode(message), encoding=JSON, timeout=1.0))


def refusals(market: RunningMarket) -> dict[str, int]:
    return market.client.control("status", homes=False).refused


def wait_for_refusals(market: RunningMarket, cause: str, more_than: int = 0) -> None:
    market.wait_for_status(lambda status: status.refused.get(cause, 0) > more_than, missing=f"refusals as {cause}")


def action(run: str, day: int, instance: str, kw: float = 2.0) -> bytes:
    return encode(FleetAction(run=run, day=day, slot=0, instance=instance, battery_kw=np.array([kw])))


# -------------------------------------------------------------------- who gets in


def test_only_who_has_a_certificate_of_this_authority_gets_a_session(
    market: RunningMarket, certs: Path, tmp_path: Path
) -> None:
    bare = zenoh.Config()
    settings = {
        "mode": "client",
        "connect/endpoints": [market.endpoint],
        "transport/link/tls/root_ca_certificate": str(certs / "ca.pem"),
    }
    for key, value in settings.items():
        bare.insert_json5(key, json.dumps(value))
    with pytest.raises(zenoh.ZError):
        zenoh.open(bare)
    with pytest.raises(BusError, match="nobody listens there"):
        open_client(market.endpoint.replace("tls/", "tcp/"), timeout_s=1.0)
    # Another authority: the clock's certificate is not accepted; and where it would be, the agent's own is not.
    strangers = make_certs(tmp_path / "strangers")
    with pytest.raises(SecurityError, match=r"the certificate of tls/.* is not accepted here"):
        session_of(market, "p1", strangers)
    (strangers / "ca.pem").write_bytes((certs / "ca.pem").read_bytes())
    with pytest.raises(SecurityError, match=r"p1\.pem is not accepted by tls/"):
        session_of(market, "p1", strangers)
    # One that is valid no more.
    old = make_certs(tmp_path / "old")
    for name in ("ca.pem", "ca.key"):
        (old / name).write_bytes((certs / name).read_bytes())
    Authority(old).issue("p1", days=0)
    with pytest.raises(SecurityError, match=r"p1\.pem is not accepted by tls/.*expired"):
        session_of(market, "p1", old)
    market.wait_for_slots(5)


def test_an_agent_cannot_pose_as_the_clock(certs: Path) -> None:
    """Whoever gets hold of an agent's key and of the clock's address still finds no agent that talks to it."""
    with RunningMarket("paper", ("--paused",), certs=certs) as market:
        market.processes["clock"].kill()
        false = zenoh.Config()
        posing = Credentials(certs, "p3").settings()
        for key, value in {**posing, "mode": "peer", "listen/endpoints": [market.endpoint]}.items():
            false.insert_json5(key, json.dumps(value))
        with (
            zenoh.open(false),
            pytest.raises(SecurityError, match=r"the certificate of tls/.* is not accepted here"),
        ):
            session_of(market, "p1")


# -------------------------------------------------------------------- what the access list stops


def test_nothing_of_others_can_be_read(market: RunningMarket) -> None:
    keys = KeyExpressions(market.run)
    heard: set[str] = set()
    slots = threading.Semaphore(0)

    def on_sample(sample: zenoh.Sample) -> None:
        heard.add(str(sample.key_expr))
        slots.release()

    with session_of(market, "p4") as session:
        wanted = (
            keys.slot,
            keys.observation("p1"),
            keys.observation("*"),
            f"{keys.base}/**",
            f"{ROOT}/**",
            keys.actions,
        )
        listening = [session.declare_subscriber(key, on_sample, allowed_origin=REMOTE) for key in wanted]
        tokens = session.liveliness().declare_subscriber(keys.anyone_alive, on_sample, history=True)
        for _ in range(20):
            assert slots.acquire(timeout=20), "no public slot came"
        answers = [
            *ask(session, keys.control, ControlRequest(command="stop")),
            *ask(session, keys.history, HistoryRequest()),
            *ask(session, keys.scenario, ScenarioRequest()),
            *ask(session, keys.policy("p1"), ControlRequest(command="status")),
            *ask(session, keys.spawner("*", "status"), ControlRequest(command="status")),
            *ask(session, f"{keys.base}/**", ControlRequest(command="status")),
            *session.liveliness().get(f"{keys.base}/**", timeout=1.0),
        ]
        assert [answer for answer in answers if answer.ok is not None and answer.ok.key_expr != keys.slot] == []
        assert heard == {keys.slot}
        # Of two questions within two milliseconds the second is dropped.
        asked = (ask(session, keys.slot, ControlRequest(command="status")) for _ in range(10))
        assert any(asked), "the price is public"
        del listening, tokens
    assert market.client.control("status").state == "running"


def test_what_is_forged_reaches_nobody(market: RunningMarket) -> None:
    keys, before = KeyExpressions(market.run), refusals(market)
    false = threading.Event()
    with session_of(market, "p4") as session:
        # As the clock, as the grid, as another home, and as all of them at once.
        answering = [
            session.declare_queryable(key, lambda query: false.set(), complete=True)
            for key in (keys.control, keys.history, keys.join("*"), keys.policy("p1"), keys.slot, f"{keys.base}/**")
        ]
        tokens = [
            session.liveliness().declare_token(key) for key in (keys.alive("p2"), keys.alive("p9"), keys.clock_alive)
        ]
        market.processes["p2"].kill()
        market.wait_for_slot(lambda slot: "p2" in slot.fallback, missing="a slot without p2")
        latest = market.last
        assert latest is not None
        price = GridAction(run=market.run, day=latest.day, slot=0, instance="0123456789abcdef", buy_price=0.1)
        forged_slot = encode(latest.model_copy(update={"position": 10**9, "buy_price": 0.1}))
        for _ in range(200):
            session.put(keys.action("grid"), encode(price), encoding=JSON)
            session.put(keys.action("p1"), action(market.run, latest.day, "0123456789abcdef"), encoding=JSON)
            session.put(keys.actions, action(market.run, latest.day, "0123456789abcdef"), encoding=JSON)
            session.delete(keys.action("p1"))
            session.put(keys.observation("p1"), b"{}")
            session.put(keys.slot, forged_slot)
        market.wait_for_slots(20)
        status = market.client.control("status")
        assert next(agent for agent in status.agents if agent.id == "p2").presence == "away", "its token was forged"
        assert market.last is not None
        assert market.last.position < 10**9
        assert market.client.history(0, 1).next == 1
        assert not false.is_set()
        del answering, tokens
    market.start_prosumer("p2", "--policy", "conventional")
    market.wait_for_slot(lambda slot: "p2" in slot.acted, missing="p2 back")
    assert refusals(market) == before, "something has reached the clock"


# -------------------------------------------------------------------- what reaches the clock


def test_an_agent_can_only_ask_for_itself_and_what_it_tries_is_counted(market: RunningMarket) -> None:
    keys = KeyExpressions(market.run)
    home = HomeSpec.model_validate({"id": "p4", "pv_kw": 3, "battery": {"capacity_kwh": 5}})

    def joins(agent: str, *homes: HomeSpec) -> JoinRequest:
        return JoinRequest(agent=agent, role="prosumer", instance=secrets.token_hex(8), homes=homes or None)

    with session_of(market, "p4") as session:
        assert ask(session, keys.join("p5"), joins("p5", home)) == [], "under another's key: stopped on the way"
        assert ask(session, keys.leave("p1"), LeaveRequest(agent="p1", instance="0123456789abcdef")) == []

        def refused(key: str, request: Message, cause: str) -> None:
            before = refusals(market).get(cause, 0)
            until = time.monotonic() + 20
            # Whoever asks more often than 20 times a second is not always heard.
            while not (answers := ask(session, key, request)):
                assert time.monotonic() < until, f"{cause}: no answer"
            (answer,) = answers
            assert answer.err is not None
            refusal = decode(Refusal, answer.err.payload.to_bytes())
            assert cause.endswith(refusal.reason), refusal
            assert refusals(market)[cause] == before + 1

        refused(keys.join("p4"), joins("p1"), "join_not_yours")
        refused(keys.join("p4"), joins("p4", home.model_copy(update={"id": "p5"})), "join_not_yours")
        refused(keys.join("p4"), joins("p4", home.model_copy(update={"id": "p1"})), "join_taken")
        refused(keys.leave("p4"), LeaveRequest(agent="p1", instance="0123456789abcdef"), "leave_not_yours")
        refused(keys.leave("p4"), LeaveRequest(agent="p4", instance="0123456789abcdef"), "leave_unknown")


def test_a_certificate_that_is_used_twice_gives_the_second_process_no_place(market: RunningMarket) -> None:
    keys, agent = KeyExpressions(market.run), "p1"
    before = refusals(market).get("second_session", 0)
    with session_of(market, agent) as thief:
        wait_for_refusals(market, "second_session", before)
        instance = secrets.token_hex(8)
        (answer,) = ask(thief, keys.join(agent), JoinRequest(agent=agent, role="prosumer", instance=instance))
        assert answer.err is not None
        assert decode(Refusal, answer.err.payload.to_bytes()).reason == "taken"
        assert refusals(market)["join_taken"] > 0
        until = time.monotonic() + 20
        while refusals(market).get("foreign", 0) == 0:
            assert time.monotonic() < until, "an action of another instance was never looked at"
            for _ in range(20):
                thief.put(keys.action(agent), action(market.run, 10**6, instance), encoding=JSON)
        (answer,) = ask(thief, keys.leave(agent), LeaveRequest(agent=agent, instance=instance))
        assert answer.err is not None
        assert decode(Refusal, answer.err.payload.to_bytes()).reason == "not_yours"
    market.wait_for_slot(lambda slot: agent in slot.acted, missing="the first process, which goes on")


def test_a_member_that_cheats_and_floods_gains_nothing_and_delays_nobody(market: RunningMarket) -> None:
    """It has joined as it may; then it replays, forges, sends too much and too often."""
    assert market.certs is not None
    keys, instance = KeyExpressions(market.run), secrets.token_hex(8)
    home = HomeSpec.model_validate({"id": "p4", "pv_kw": 3, "battery": {"capacity_kwh": 5}})
    with AgentLink("p4", market.run, market.endpoint, certs=market.certs) as link:
        request = JoinRequest(agent="p4", role="prosumer", instance=instance, homes=(home,))
        assert link.join(request).homes == link.join(request).homes, "joining twice changes nothing"
        link.ready()
        before = refusals(market)
        first = market.wait_for_slots(1).position
        for _ in range(10):
            arrival = link.receive()
            assert arrival is not None
            seen = decode(FleetObservation, arrival.payload, arrival.encoding)
            link.act(action(market.run, seen.day, instance).replace(b'"slot":0', b'"slot":%d' % seen.slot), JSON)
        day = seen.day
        with session_of(market, "p4") as other:
            until = time.monotonic() + 3.0
            while time.monotonic() < until:
                for _ in range(200):
                    link.act(action(market.run, max(day - 1, 0), instance), JSON)  # yesterday's
                    link.act(
                        encode(GridAction(run=market.run, day=day, slot=0, instance=instance, buy_price=0.1)), JSON
                    )
                    link.act(b"x" * 100_000, JSON)
                for _ in range(50):
                    other.get(keys.join("p4"), payload=encode(request), timeout=0.2)
                    other.liveliness().declare_token(keys.alive("p4")).undeclare()
        assert market.wait_for_slots(5).position > first + 5
        counted = refusals(market)
        for cause in ("late", "malformed", "oversized"):
            assert counted.get(cause, 0) > before.get(cause, 0), counted
        link.leave(instance)
    market.wait_for_slot(lambda slot: slot.homes == 3, missing="a slot without p4")


def test_the_page_starts_homes_that_have_a_certificate(certs: Path, tmp_path: Path) -> None:
    home = {"id": "p4", "pv_kw": 5, "battery": {"capacity_kwh": 10}}
    with RunningMarket("paper", ("--speed", "72000x"), certs=certs) as market:
        market.start_agents(*PAPER)
        start_spawner(market)
        market.wait_for_slots(2, 40)
        with gateway(market) as page:
            page.wait("/v1/spawners", lambda answer: bool(answer.json().get("spawners")), "the spawner")
            assert page.post("/v1/prosumers", home, 201)["process"]["state"] == "running"
            assert "p9.pem: no such file" in page.post("/v1/prosumers", home | {"id": "p9"}, 422)["detail"]
            page.wait("/metrics", lambda answer: "zengrid_market_up 1" in answer.text, "the metrics")
            assert page.http.delete("/v1/prosumers/p4").status_code == 204


def test_an_operator_may_look_and_steer_and_a_name_off_the_list_may_nothing(certs: Path, tmp_path: Path) -> None:
    mine = make_certs(tmp_path / "mine", "--ids", "p7")
    make_certs(mine, "--revoke", "p7")
    with RunningMarket("paper", ("--wait", "0"), certs=mine) as market:
        market.wait_for_slots(1)
        with MarketClient(market.run, market.endpoint, certs=mine, name="gateway", timeout_s=20.0) as viewer:
            assert "paper" in viewer.scenario()
        with session_of(market, "p7") as session:
            keys = KeyExpressions(market.run)
            assert ask(session, keys.slot, ControlRequest(command="status")) == []
            assert ask(session, keys.join("p7"), JoinRequest(agent="p7", role="prosumer", instance="0" * 16)) == []
