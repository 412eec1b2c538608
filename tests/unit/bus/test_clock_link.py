"""The clock's queue by a real session: it takes a bounded number of questions, and loses none in silence."""

from __future__ import annotations

import json
import threading
import time
from collections import Counter

import zenoh

from zengrid.bus.clock_link import QUERIES_LIMIT, ClockLink
from zengrid.bus.zenoh_session import open_client
from zengrid.testing import free_endpoint

BEYOND = 50
PATIENCE_S = 60.0


def test_questions_beyond_the_limit_are_refused_at_once_and_counted() -> None:
    endpoint = free_endpoint()
    with ClockLink("main", endpoint) as hub, open_client(endpoint) as session:
        answers: Counter[str] = Counter()
        refused, done = threading.Event(), threading.Event()

        def answered(reply: zenoh.Reply) -> None:
            said = reply.ok if reply.ok is not None else reply.err
            assert said is not None
            answers[json.loads(said.payload.to_string())["reason"]] += 1
            if answers["unavailable"] == BEYOND:
                refused.set()
            if answers.total() == QUERIES_LIMIT + BEYOND:
                done.set()

        for _ in range(QUERIES_LIMIT + BEYOND):
            session.get(
                hub.keys.join("p1"),
                zenoh.handlers.Callback(answered, indirect=False),
                payload=b"{}",
                timeout=2 * PATIENCE_S,
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
        assert refused.wait(PATIENCE_S), answers
        assert answers == {"unavailable": BEYOND}
        assert hub.overflowed == {"join_overflow": BEYOND}

        # A home that went away is noticed all the same, and whoever waits gets an answer.
        token = session.liveliness().declare_token(hub.keys.alive("p1"))
        kinds: Counter[str] = Counter()
        until = time.monotonic() + PATIENCE_S
        while not (kinds["alive"] and kinds["join"] == QUERIES_LIMIT):
            assert time.monotonic() < until, kinds
            event = hub.receive(1.0)
            if event is None:
                continue
            kinds[event.kind] += 1
            if event.query is not None:
                event.query.refuse("unknown", "tried")
        token.undeclare()
        assert done.wait(PATIENCE_S), answers
        assert answers == {"unavailable": BEYOND, "unknown": QUERIES_LIMIT}
        assert hub.overflowed == {"join_overflow": BEYOND}
