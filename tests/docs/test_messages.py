"""Messages in the documentation follow the schemas, and a conversation shown there is what a real market says."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
import zenoh

from message_schemas import MESSAGES
from support.doc_pages import blocks
from zengrid.testing import RunningMarket
from zengrid.wire.base import Message
from zengrid.wire.codec import decode

KINDS: dict[str, type[Message]] = {kind.__name__: kind for kind in MESSAGES}
SHOWN = [
    pytest.param(block.title, block.text, id=f"{page}:{block.line}:{block.title}")
    for page in ("docs/protocol.md", "docs/own-agent.md")
    for block in blocks(page, "json")
    if block.title
]


@pytest.mark.parametrize(("kind", "text"), SHOWN)
def test_messages_follow_the_schema(kind: str, text: str) -> None:
    decode(KINDS[kind], text.encode())


def test_zenoh_settings_are_accepted() -> None:
    (block,) = (block for block in blocks("docs/protocol.md", "json") if not block.title)
    assert json.loads(zenoh.Config.from_json5(block.text).get_json("connect/endpoints")) == ["tcp/127.0.0.1:7447"]


def test_a_real_market_sends_what_the_page_shows() -> None:
    """Plays the conversation of docs/own-agent.md word by word."""
    (script,) = (block.text for block in blocks("docs/own-agent.md", "text") if block.text.startswith("SUBSCRIBE"))
    steps = [step.split(None, 1) for step in re.split(r"\n\n", script.strip())]
    with RunningMarket("paper", ("--paused",), run="main") as market:
        market.start_agents("p1", "p2", "p3")
        market.wait_for_status(lambda s: s.state == "paused", missing="the market ready")
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([market.endpoint]))
        with zenoh.open(config) as session:
            heard: dict[str, Any] = {}
            for word, rest in steps:
                key, _, payload = rest.partition("\n") if rest.startswith("zengrid/") else ("", "", rest)
                message = json.loads(payload) if payload else {}
                if word == "SUBSCRIBE":
                    observations = session.declare_subscriber(key, zenoh.handlers.FifoChannel(64))
                elif word == "GET":
                    (reply,) = session.get(key, payload=payload)
                    assert reply.ok is not None, reply.err and reply.err.payload.to_string()
                    heard = json.loads(reply.ok.payload.to_string())
                elif word == "TOKEN":
                    token = session.liveliness().declare_token(key)
                    market.wait_for_status(lambda s: s.agents[-1].presence == "present", missing="the agent ready")
                elif word == "PUT":
                    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
                    market.wait_for_slot(message["slot"])
                elif word == "RECEIVE":
                    market.client.control("step")
                    same(json.loads(observations.recv().payload.to_string()), message)
                else:
                    assert word == "REPLY"
                    same(heard, message)
            token.undeclare()
        assert market.client.control("status").refused == {}


def same(said: Any, shown: Any) -> None:
    """Equal, but for the last digits of numbers, which may depend on the machine."""
    if isinstance(shown, dict):
        assert said.keys() == shown.keys()
        for name, value in shown.items():
            same(said[name], value)
    elif isinstance(shown, list):
        assert len(said) == len(shown)
        for one, other in zip(said, shown, strict=True):
            same(one, other)
    elif isinstance(shown, float):
        assert said == pytest.approx(shown, rel=1e-9)
    else:
        assert said == shown
