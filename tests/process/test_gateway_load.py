"""Requests made to keep a gateway busy: each is refused in a bounded time, and nobody else waits for it."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from support.gateway_process import Gateway, running

QUERY = "/v1/policies/p1/query"
BODY = 2 * 2**20
"""Largest body. [bytes]"""
AT_ONCE = 10
WITHIN_S = 60.0
"""Longest time for so many attacks, on a machine that does other things, too: most take a second together."""


def get(target: str, *headers: str, host: str = "localhost", method: str = "GET") -> bytes:
    lines = (f"{method} {target} HTTP/1.1", f"Host: {host}", "Connection: close", *headers)
    return "".join(f"{line}\r\n" for line in lines).encode("latin-1") + b"\r\n"


def post(target: str, body: bytes, *headers: str) -> bytes:
    about = ("Content-Type: application/json", f"Content-Length: {len(body)}")
    return get(target, *about, *headers, method="POST") + body


def filled(start: bytes, item: bytes, end: bytes, size: int = BODY) -> bytes:
    """A body of (almost) a size, full of the same thing."""
    count = (size - len(start) - len(end)) // (len(item) + 1)
    return start + b",".join([item] * count) + end


def fields(start: bytes, count: int, value: bytes, end: bytes) -> bytes:
    """A body with so many fields."""
    return start + b",".join(b'"%06d":%b' % (i, value) for i in range(count)) + end


ATTACKS = {
    "wrong values": (post(QUERY, filled(b'{"observations":[[', b'""', b"]]}", 15_000)), 422),
    "rows of wrong values": (post(QUERY, filled(b'{"observations":[', b'[""]', b"]}", 40_000)), 422),
    "more wrong values": (post(QUERY, filled(b'{"observations":[[', b'""', b"]]}")), 413),
    "one long row": (post(QUERY, filled(b'{"observations":[[', b"1", b"]]}", 300_000)), 422),
    "wrong quantities": (post(QUERY, fields(b'{"quantities":{', 998, b'["",1]', b"}}")), 422),
    "more wrong quantities": (post(QUERY, fields(b'{"quantities":{', 150_000, b'""', b"}}")), 413),
    "unknown fields": (post(QUERY, fields(b"{", 999, b"1", b"}")), 422),
    "more unknown fields": (post("/v1/prosumers", fields(b"{", 150_000, b"1", b"}")), 413),
    "unknown fields of a battery": (post("/v1/prosumers", fields(b'{"battery":{', 998, b"1", b"}}")), 422),
    "unknown fields of a command": (post("/v1/control", fields(b"{", 999, b"1", b"}")), 422),
    "a long text": (post(QUERY, b'{"home":"%b"}' % (b"a" * (BODY - 11))), 422),
    "a long name": (post(QUERY, b'{"%b":1}' % (b"a" * (BODY - 11))), 422),
    "a long quantity": (post(QUERY, b'{"quantities":{"%b":1}}' % (b"a" * (BODY - 30))), 422),
    "a long number": (post(QUERY, b'{"observations":[[%b]]}' % (b"1" * (BODY - 30))), 422),
    "long numbers": (post(QUERY, filled(b'{"observations":[[', b"1" * 4000, b"]]}")), 422),
    "nested": (post(QUERY, b"[" * 90_000 + b"]" * 90_000), 422),
    "nested without end": (post(QUERY, b"[" * BODY), 413),
    "no text": (post(QUERY, b'{"home":"%b"}' % (b"\xff" * (BODY - 11))), 422),
    "half a character": (post(QUERY, b'{"home":"\\ud800"}'), 422),
    "parameters": (get("/v1/history?" + "&".join(map(str, range(10_000)))), 414),
    "short parameters": (get("/v1/history?" + "&" * 8000), 414),
    "as many parameters as allowed": (get("/v1/history?" + "&".join(map(str, range(100)))), 422),
    "a long path": (get("/v1/" + "/" * 10_000_000), 414),
    "a long path of another method": (get("/" * 8000, method="DELETE"), 404),
    "headers": (get("/v1/price", *(f"a{i}: 1" for i in range(100_000))), 431),
    "a long header": (get("/v1/price", "a: " + "x" * 10_000_000), 431),
    "long headers": (get("/v1/price", *(f"a{i}: {'x' * 1000}" for i in range(90))), 431),
    "chunks": (get("/v1/price", "Transfer-Encoding: chunked") + b"0\r\n\r\n", 411),
    "a long last event": (get("/v1/live", "Last-Event-ID: " + "9" * 5000), 422),
    "no origin": (post("/v1/control", b'{"command":"resume"}', "Origin: http://["), 403),
    "no host": (get("/v1/price", host="[::1].evil.com"), 421),
    "two hosts": (get("/v1/price", "Host: evil.com"), 421),
    "no length": (get("/v1/price", "Content-Length: " + "9" * 5000), 400),
    "no HTTP": (b"\x16\x03\x01\x00\x00\r\n\r\n", 400),
    "bytes in a URL": (get("/v1/history?\xff=1"), 400),
}


@pytest.fixture(scope="module")
def gateway() -> Iterator[Gateway]:
    with running("--speed", "3600x") as it:
        yield it


def answer(gateway: Gateway, request: bytes) -> tuple[int, Any]:
    """Status and problem that a request is answered with."""
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=WITHIN_S) as raw:
        raw.sendall(request)
        head, _, body = b"".join(iter(lambda: raw.recv(65536), b"")).partition(b"\r\n\r\n")
    assert b"content-type: application/problem+json" in head
    assert b"x-content-type-options: nosniff" in head
    assert len(body) < 20_000
    return int(head.split()[1]), json.loads(body)


@pytest.mark.parametrize(("request_", "status"), ATTACKS.values(), ids=ATTACKS)
def test_an_attack_is_refused_and_holds_up_nobody(gateway: Gateway, request_: bytes, status: int) -> None:
    began = time.monotonic()
    with ThreadPoolExecutor(AT_ONCE) as attackers:
        attacks = [attackers.submit(answer, gateway, request_) for _ in range(AT_ONCE)]
        waiting = True
        while waiting:
            waiting = not all(attack.done() for attack in attacks)
            assert gateway.get("/healthz") == {"status": "ok"}
            assert gateway.get("/v1/market")["run"] == "test"
        answers = [attack.result() for attack in attacks]
    assert time.monotonic() - began < WITHIN_S
    for code, problem in answers:
        assert code == problem["status"] == status, problem
        assert len(problem["errors"]) <= 20
        assert len(problem["detail"]) <= 2000
    assert "Traceback" not in gateway.process.output()


def test_it_is_told_how_many_more_fields_are_wrong(gateway: Gateway) -> None:
    few = gateway.get("/v1/history?a=1&b=2", 422)
    assert ([error["field"] for error in few["errors"]], few["more"]) == (["query.a", "query.b"], 0)
    many = gateway.get("/v1/history?" + "&".join(f"a{i}=1" for i in range(100)), 422)
    assert [error["field"] for error in many["errors"]] == [f"query.a{i}" for i in range(20)]
    assert many["more"] == 80
    some = gateway.post(QUERY, {"quantities": {f"a{i}": "x" for i in range(900)}}, 422)
    assert (len(some["errors"]), some["more"]) == (20, 880)


def test_every_body_is_counted(gateway: Gateway) -> None:
    document = gateway.get("/openapi.json")
    routes = [
        (path, method) for path, item in document["paths"].items() for method in item if "requestBody" in item[method]
    ]
    assert len(routes) >= 3
    for path, method in routes:
        body = fields(b"{", 1001, b"1", b"}")
        refused = gateway.http.request(
            method, path.format(agent="p1"), content=body, headers={"content-type": "application/json"}
        )
        assert refused.status_code == 413, f"{method} {path}"
        assert "1001 fields" in refused.json()["detail"]


def test_refusals_are_counted(gateway: Gateway) -> None:
    assert answer(gateway, get("/" + "x" * 10_000))[0] == 414
    assert 'zengrid_http_seconds_count{route="other",status="414"}' in gateway.http.get("/metrics").text


def test_requests_sent_ahead_have_an_end(gateway: Gateway) -> None:
    request = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n"
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=WITHIN_S) as raw:
        raw.sendall(request * 6000)
        received = bytearray()
        with contextlib.suppress(ConnectionResetError):  # requests that nobody has read
            while part := raw.recv(65536):
                received += part
    assert 1 <= received.count(b"HTTP/1.1 200") <= 102
    assert gateway.get("/healthz") == {"status": "ok"}
    assert "Traceback" not in gateway.process.output()


def test_what_follows_a_body_has_an_end(gateway: Gateway) -> None:
    start = b"GET /v1/price HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\na: "
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=WITHIN_S) as raw:
        raw.sendall(start)
        received = b""
        while not received.endswith(b"}"):
            part = raw.recv(65536)
            assert part, received
            received += part
        assert received.startswith(b"HTTP/1.1 411")
        raw.sendall(b"x" * 10_000_000)
        assert b"".join(iter(lambda: raw.recv(65536), b"")).startswith(b"HTTP/1.1 431")


def test_a_refusal_ends_the_connection_and_no_answer_before_it(gateway: Gateway) -> None:
    with socket.create_connection(("127.0.0.1", gateway.port), timeout=WITHIN_S) as raw:
        raw.sendall(b"GET /v1/live HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert raw.recv(65536).startswith(b"HTTP/1.1 200")
        raw.sendall(get("/" + "x" * 10_000))
        rest = b"".join(iter(lambda: raw.recv(65536), b""))
    assert b"HTTP/1.1" not in rest
    assert "Traceback" not in gateway.process.output()


def test_an_agent_that_hangs_holds_up_its_own_questions_alone(gateway: Gateway) -> None:
    agent = gateway.market.processes["p2"]
    question = {"observations": [[0.5, 3.0, 1.0, 0.07, 0.0, -1.0, 0.095]]}
    agent.signal(signal.SIGSTOP)
    try:
        with ThreadPoolExecutor(3 * AT_ONCE) as clients:
            asked = [
                clients.submit(gateway.http.post, "/v1/policies/p2/query", json=question) for _ in range(3 * AT_ONCE)
            ]
            for _ in range(20):
                assert gateway.post("/v1/control", {"command": "resume"})["state"] == "running"
            assert not all(each.done() for each in asked)
            agent.signal(signal.SIGCONT)
            assert {each.result().status_code for each in asked} <= {200, 503}
    finally:
        agent.signal(signal.SIGCONT)
