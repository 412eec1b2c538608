"""A spawner that is asked for anything: it refuses with a reason, and its homes go on."""

from __future__ import annotations

import json
import shutil
import signal
import stat
from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any, cast

import pytest
from httpx import Response

from support.gateway_process import Gateway, running
from zengrid.bus.market_client import SPAWN_S
from zengrid.bus.spawner_link import SpawnerLink
from zengrid.errors import RefusedError
from zengrid.scenario import HomeSpec
from zengrid.testing import RunningMarket
from zengrid.wire.codec import decode
from zengrid.wire.queries import Refusal
from zengrid.wire.spawner_queries import ProcessStatus, SpawnerStatus, SpawnRequest, StopRequest
from zengrid_spawner.service import Inbox, Spawner
from zengrid_spawner.settings import Settings

NAME = "cellar"
HOME: dict[str, Any] = {"id": "p9", "pv_kw": 5, "battery": {"capacity_kwh": 10}}
LARGE = 10**400
DEEP = 32_000
"""What is longer travels in pieces, which Zenoh drops where the clock has no room to pass them on."""

POLICIES: list[Any] = [
    "random:\0", "\0", "trained\0", "trained\n", "trained\r\nzengrid spawner: all is well", "\x1b[2Jtrained", "\x7f",
    "trained\x9b31m", "conventional\u2028", "conventional\u202e", "\ufeffidle", "a\u0301\u200b", "trained:..",
    "trained:../x", "../x", "..", ".", "/etc/passwd", "/etc/passwd.safetensors", "../x.safetensors", "x.safetensors",
    "random:../x.safetensors", "random:x.safetensors", "idle:1", "generic:", "random:-1", "random:1e3", "random:1.5",
    "random:\u0663", f"random:{2**63}", "random:" + "9" * 190, "a" * 200, "a" * 201, "\U0001f600" * 200,
    "", " ", "conventional ", "CONVENTIONAL", "$(reboot)", "; reboot", "--learn", "-h", "trained --learn",
    "optimum:scenario=../x", "optimum:scenario=/etc/passwd", "optimum:scenario=mine.yaml", "optimum:data=/",
    "optimum:seed=x", "optimum:all=1", "optimum:prices=cheap", "optimum:prices=0.05,0.06", 5, True,
    None, ["trained"], {},
]  # fmt: skip

WRONG_KW: list[Any] = ["5", "", True, False, -1, 1e300, LARGE, None, [], {}, "nan"]
WRONG_BATTERIES: list[Any] = [
    {"capacity_kwh": "10"}, {"capacity_kwh": True}, {"capacity_kwh": 1e7}, {"capacity_kwh": None},
    {"soc_min": "0.1"},
    {"soc_min": 0.9, "soc_max": 0.1}, {"charge_efficiency": 0}, {"colour": "red"}, [], None, 10, "large",
]  # fmt: skip
HOMES: list[Any] = [
    *[HOME | {"id": id} for id in (
        "", "A", "../x", "p/x", "a" * 64, "a" * 200, "p\0", "-x", "p 4", "..", "p4\n", "\u00e9", 5, None, True, ["p9"],
    )],
    *[HOME | {"pv_kw": kw} for kw in WRONG_KW],
    *[HOME | {"battery": battery} for battery in WRONG_BATTERIES],
    *[HOME | {"load": load} for load in ({"scale": "1"}, {"scale": -1}, {"profile": "x\0"}, {"profile": "x" * 201}, 1)],
    *[HOME | {"seed": seed} for seed in (1.5, "1", -1, 2**63, LARGE, True, None)],
    HOME | {"colour": "red"}, HOME | {"tilt_deg": "30"}, [HOME], "p9", 9, None, {},
]  # fmt: skip

WHOLE: list[bytes] = [
    b"", b"{", b"[", b"null", b"5", b'"home"', b"\xff\xfe\x00", b"\0" * 1000, b"[" * DEEP, b'{"home":' * (DEEP // 8),
    b'{"home": ' + json.dumps(HOME).encode() + b', "policy": "\\ud800"}', b"{} {}", b"x" * DEEP,
    b'{"home": {"id": "p9", "pv_kw": NaN}}', b'{"home": {"id": "p9", "pv_kw": 1e999}}',
    b'{"home": {"id": "p9", "pv_kw": -Infinity}}',
]  # fmt: skip


WRONG_FIELDS: list[dict[str, Any]] = [
    {"v": 2}, {"v": "1"}, {"key": "\0"}, {"key": "k" * 201}, {"key": 5}, {"more": 1}, {"home": {}},
]  # fmt: skip


def requests() -> list[bytes]:
    made = [json.dumps({"home": HOME, "policy": policy}).encode() for policy in POLICIES]
    made += [json.dumps({"home": home}).encode() for home in HOMES]
    made += [json.dumps({"home": HOME, **more}).encode() for more in WRONG_FIELDS]
    return made + WHOLE


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gateway]:
    with running("--speed", "72000x", spawner=("--name", NAME)) as it:
        yield it


def status(gateway: Gateway) -> SpawnerStatus:
    (found,) = gateway.market.client.spawners()
    return found


def ask(gateway: Gateway, what: str, payload: bytes) -> Refusal | None:
    """Ask in plain Zenoh; the refusal, or None where it was granted."""
    client = gateway.market.client
    key = client.keys.spawner(NAME, what)  # type: ignore[arg-type]
    (reply,) = client.session.get(key, payload=payload, timeout=SPAWN_S)
    return None if reply.err is None else decode(Refusal, reply.err.payload.to_bytes())


@pytest.fixture(scope="module")
def home(gateway: Gateway) -> ProcessStatus:
    """A home that the spawner has started already."""
    request = SpawnRequest(home=HomeSpec(id="p4", pv_kw=5), policy="conventional")
    process = gateway.market.client.spawn(NAME, request)
    wait_until_it_runs(gateway, "p4")
    return process


def wait_until_it_runs(gateway: Gateway, id: str) -> None:
    """A busy machine may take longer to start a process than whoever asked is kept waiting."""

    def runs(answer: Response) -> bool:
        processes = answer.json()["spawners"][0]["processes"]
        return any((process["id"], process["state"]) == (id, "running") for process in processes)

    gateway.wait("/v1/spawners", runs, f"the process of {id}")


def goes_on(gateway: Gateway, home: ProcessStatus) -> None:
    """The spawner and its home are those of the beginning, and the home acts."""
    assert gateway.market.processes["spawner"].popen.poll() is None
    (process,) = [each for each in status(gateway).processes if each.id == "p4"]
    assert (process.pid, process.state, process.restarts) == (home.pid, "running", 0)
    before = gateway.get("/v1/prosumers/p4")["acted"]
    gateway.wait("/v1/prosumers/p4", lambda answer: answer.json()["acted"] > before + 3, "actions of p4")


@pytest.mark.timeout(600)
def test_whatever_is_asked_for_is_refused_with_a_reason(gateway: Gateway, home: ProcessStatus) -> None:
    payloads = requests()
    assert len(payloads) > 100
    before = sum(status(gateway).refused.values())
    for payload in payloads:
        refusal = ask(gateway, "spawn", payload)
        assert refusal is not None, payload[:200]
        assert refusal.reason == "invalid", (payload[:200], refusal)
        assert 10 < len(refusal.message) < 1000, payload[:200]
        assert refusal.message.isprintable(), payload[:200]
    assert sum(status(gateway).refused.values()) == before + len(payloads)
    assert set(status(gateway).refused) == {"spawn_invalid"}
    goes_on(gateway, home)
    # For none of them a process was started.
    assert [path.name for path in (gateway.market.folder / "spawner").iterdir()] == ["p4.log"]
    assert gateway.get("/v1/prosumers")["total"] == 4


def test_stops_and_questions_of_any_kind_are_refused(gateway: Gateway, home: ProcessStatus) -> None:
    for payload in (b"{", b"null", b'{"id": 5}', b'{"id": "../p4"}', b'{"id": "p4\\u0000"}', b"[" * DEEP):
        refusal = ask(gateway, "stop", payload)
        assert refusal is not None
        assert refusal.reason == "invalid"
    refusal = ask(gateway, "stop", b'{"id": "p77"}')
    assert refusal is not None
    assert (refusal.reason, "p4" in refusal.message) == ("unknown", True)
    goes_on(gateway, home)


@pytest.mark.parametrize(
    ("home", "field"),
    [
        (HOME | {"policy": "random:\0"}, "body.policy"),
        (HOME | {"policy": "trained\x1b[2J"}, "body.policy"),
        (HOME | {"policy": "trained:.."}, "body.policy"),
        (HOME | {"policy": "random:../x.safetensors"}, "body.policy"),
        (HOME | {"pv_kw": "5"}, "body.pv_kw"),
        (HOME | {"pv_kw": True}, "body.pv_kw"),
        (HOME | {"battery": {"capacity_kwh": "10"}}, "body.battery.capacity_kwh"),
        (HOME | {"load": {"scale": False}}, "body.load.scale"),
        (HOME | {"load": {"profile": "\0"}}, "body.load.profile"),
        (HOME | {"seed": "1"}, "body.seed"),
    ],
)
def test_the_same_over_http(gateway: Gateway, home: dict[str, Any], field: str) -> None:
    problem = gateway.post("/v1/prosumers", home, 422)
    assert [error["field"] for error in problem["errors"]] == [field]
    assert problem["detail"].isprintable()


def test_logs_are_their_owners_alone(gateway: Gateway, home: ProcessStatus) -> None:
    folder = gateway.market.folder / "spawner"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}


def test_a_process_that_cannot_be_started_is_told_to_whoever_asked(gateway: Gateway, home: ProcessStatus) -> None:
    folder, client = gateway.market.folder / "spawner", gateway.market.client
    shutil.rmtree(folder)
    request = SpawnRequest(home=HomeSpec(id="p10", pv_kw=5), policy="conventional", key="a key")
    with pytest.raises(RefusedError, match=r"p10: cannot be started: .*No such file or directory") as error:
        client.spawn(NAME, request)
    assert error.value.reason == "unavailable"
    goes_on(gateway, home)
    folder.mkdir()
    assert client.spawn(NAME, request).pid is not None
    wait_until_it_runs(gateway, "p10")


@pytest.fixture
def signals() -> Iterator[None]:
    """Those that a spawner takes over in this process."""
    numbers = (signal.SIGCHLD, signal.SIGTERM, signal.SIGINT)
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("signals")
def test_an_error_that_nobody_foresaw_refuses_one_request(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # No folder: whatever looks into it fails.
    broken = Settings(
        name=NAME, run="test", logs=tmp_path, policies=cast("Path", 5), limit=64, memory_mb=8192.0,
        process_memory_mb=512.0,
    )  # fmt: skip
    inbox: Inbox = SimpleQueue()
    refused: list[RefusedError] = []

    def ask_twice() -> None:
        try:
            for _ in range(2):
                with pytest.raises(RefusedError) as error:
                    market.client.spawn(NAME, SpawnRequest(home=HomeSpec(id="p9"), policy="conventional"))
                refused.append(error.value)
            with pytest.raises(RefusedError) as error:
                market.client.stop_process(NAME, StopRequest(id="p9"))
            refused.append(error.value)
        finally:
            inbox.put("end")

    with RunningMarket("paper") as market, SpawnerLink(NAME, "test", market.endpoint, on_event=inbox.put):
        asking = Thread(target=ask_twice)
        asking.start()
        Spawner(broken, inbox).serve()
        asking.join()
    assert [error.reason for error in refused] == ["unavailable", "unavailable", "unknown"]
    assert str(refused[0]) == "AttributeError: 'int' object has no attribute 'glob'"
    said = capsys.readouterr().err
    assert said.count("unexpected error in a request (spawn): AttributeError") == 2
    assert "Traceback" in said
