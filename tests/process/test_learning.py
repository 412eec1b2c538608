"""Agents that learn in a market of real processes: they cost no deadline, keep what they learned, and change."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

from support.zengrid_up import ZengridUp
from zengrid.bus.market_client import MarketClient
from zengrid.journal import Journal
from zengrid.policy.file import PolicyFile

PATIENCE_S = 120.0
"""Loading torch takes 3 s on an idle machine, and much longer on a busy one."""
AGENTS = ("grid", "prosumer p1", "prosumer p2", "prosumer p3")
DEADLINE = ("--deadline", "20")
"""No test of speed: on a busy machine any process may stand still for seconds."""


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_agents_learn_at_full_speed_and_go_on_where_they_were_killed(tmp_path: Path) -> None:
    learned = tmp_path / "learned"
    options = ("paper", "--quiet", "--learn", "--learned", str(learned), "--explore", "300", *DEADLINE)
    start = ("--policy", "conventional", "--grid-policy", "fixed")
    with ZengridUp(tmp_path, *options, *start, "--paused") as up:
        up.patience_s = PATIENCE_S
        children = {name: up.child(f"zengrid {name}") for name in AGENTS}
        with MarketClient("main", up.endpoint, timeout_s=PATIENCE_S) as client:
            up.status(client, lambda status: all(agent.presence == "present" for agent in status.agents))
            client.control("resume")
            status = up.status(client, lambda status: status.totals.slots > 300)
            assert {agent.id: agent.fallbacks for agent in status.agents} == dict.fromkeys(
                ("grid", "p1", "p2", "p3"), 0
            )
            up.until((learned / "p1.safetensors").exists, "a policy of p1 on disk")
            before = (learned / "p1.safetensors").stat().st_mtime_ns
            children["prosumer p1"].send_signal(signal.SIGKILL)
            up.child("zengrid prosumer p1", not_pid=children["prosumer p1"].pid)
            log = tmp_path / "runs" / "main" / "prosumer-p1.log"
            up.until(lambda: "p1 goes on learning after" in log.read_text(), "p1 going on")
            up.until(lambda: (learned / "p1.safetensors").stat().st_mtime_ns > before, "p1 keeping more")
        up.signal(signal.SIGINT)
        assert up.end() == 0, up.output()
    with Journal.open(up.journal, read_only=True) as journal:
        records = list(journal.run().records())
    # It began as the market without demand response, and is another one now.
    assert {record.buy_price for record in records[:24]} == {0.05}
    assert len({record.buy_price for record in records}) > 3
    files = {name: PolicyFile.load(learned / f"{name}.safetensors") for name in ("grid", "p1", "p2", "p3")}
    assert all(file.training["slots"] > 200 for file in files.values())
