"""``zengrid up`` with real processes: it starts, survives the death of any child, and leaves nothing behind."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from support.zengrid_up import DEADLINE_S, ZengridUp
from zengrid.bus.market_client import MarketClient
from zengrid.journal import Journal
from zengrid.testing import free_port

SLOW = ("--speed", "36000x")
"""Ten slots a second: a market that neither ends nor keeps this machine busy."""
AGENTS = ("zengrid grid", "zengrid prosumer p1", "zengrid prosumer p2", "zengrid prosumer p3")


def zengrid(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "zengrid_cli", *words], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )


def positions(up: ZengridUp) -> list[int]:
    with Journal.open(up.journal, read_only=True) as journal:
        return [record.position for record in journal.run().records(limit=10**6)]


def test_it_runs_the_given_days_and_prints_a_summary(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, "--days", "2", "--speed", "36000x", "--plain") as up:
        assert up.end() == 0
        said = up.process.output()
    assert positions(up) == list(range(48))
    assert f"paper at {up.endpoint}" in said
    assert "48 slots (2 days) settled; run main-1" in said
    assert "First slot after" in said
    assert "bill p3" in said
    assert "zengrid export --run main-1" in said
    assert "To continue" not in said
    assert "exit code" not in said
    assert not up.left()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    with ZengridUp(tmp_path, *SLOW) as up:
        with up.client():
            assert set(AGENTS) <= set(up.children())
            up.signal(number)
            assert up.end() == 0
        assert "To continue where it ended: zengrid up --speed 36000x" in up.process.output()
        assert "exit code" not in up.output()
        assert not up.left()


def test_it_goes_on_where_it_ended(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up, up.client() as client:
        client.control("stop")
        assert up.end() == 0
    before = positions(up)
    with ZengridUp(tmp_path, "--days", "2", "--resume") as up:
        assert up.end() == 0
        assert "slots (2 days) settled; run main-1" in up.process.output()
    assert len(before) < 48
    assert positions(up) == list(range(48))


@pytest.mark.parametrize("title", AGENTS)
def test_an_agent_that_is_killed_is_back(tmp_path: Path, title: str) -> None:
    agent = title.split()[-1]
    with ZengridUp(tmp_path, *SLOW) as up, up.client() as client:
        first = up.child(title)
        first.kill()
        up.child(title, not_pid=first.pid)
        before = {agent.id: agent.acted for agent in client.control("status").agents}
        up.status(client, lambda status: all(it.acted > before[agent] + 3 for it in status.agents if it.id == agent))
        assert f"{title.removeprefix('zengrid ')}: killed by SIGKILL; starting it again in 0.1 s" in up.process.output()


def test_a_clock_that_is_killed_goes_on_where_its_journal_ends(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, "--days", "3", *SLOW) as up, up.client() as client:
        clock = up.child("zengrid clock")
        position = client.control("status").last
        clock.kill()
        up.child("zengrid clock", not_pid=clock.pid)
        assert position is not None
        at = position.position
        up.status(client, lambda status: status.last is not None and status.last.position > at + 3)
        up.status(client, lambda status: all(agent.presence == "present" for agent in status.agents))
        client.control("speed", speed=0.0)
        assert up.end() == 0
        assert "clock: killed by SIGKILL" in up.process.output()
        assert "72 slots (3 days) settled; run main-1" in up.process.output()
    assert positions(up) == list(range(72))


def test_nothing_outlives_a_supervisor_that_is_killed(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up, up.client():
        up.child("zengrid top")
        assert len(up.children()) == 6
        up.process.kill()
        # Nobody is left to wait for: look at the children themselves.
        for child in up.left():
            child.wait(DEADLINE_S)
        assert not up.left()


@pytest.mark.slow
def test_an_agent_that_keeps_failing_is_given_up_and_the_market_goes_on(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up, up.client() as client:
        pid = 0
        for _ in range(6):
            child = up.child("zengrid prosumer p2", not_pid=pid)
            pid = child.pid
            child.kill()
        up.until(lambda: "given up" in up.process.output(), "p2 is given up")
        at = client.control("status").totals.slots
        status = up.status(client, lambda status: status.totals.slots > at + 3)
        assert {agent.id: agent.presence for agent in status.agents}["p2"] == "away"
        up.signal(signal.SIGINT)
        assert up.end() == 0


@pytest.mark.slow
def test_a_clock_that_keeps_failing_ends_everything(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up:
        pid = 0
        for _ in range(6):
            child = up.child("zengrid clock", not_pid=pid)
            pid = child.pid
            child.kill()
        assert up.end() == 1
        assert "clock: killed by SIGKILL, 6 failures within 60 s; given up" in up.process.output()
        assert not up.left()


def test_a_second_signal_ends_it_at_once(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up, up.client():
        up.child("zengrid clock").suspend()
        up.signal(signal.SIGINT)
        up.signal(signal.SIGTERM)
        assert up.end() == 130
        assert not up.left()


def test_the_price_is_on_the_page(tmp_path: Path) -> None:
    port = free_port()
    with ZengridUp(tmp_path, *SLOW, "--http", str(port)) as up, up.client():
        up.child("zengrid gateway")

        def answers() -> bool:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{port}/v1/price", timeout=1.0) as reply:
                    return "buy_price" in json.load(reply)
            except OSError:
                return False

        up.until(answers, "GET /v1/price")


def test_it_is_watched_and_steered_from_elsewhere(tmp_path: Path) -> None:
    with ZengridUp(tmp_path, *SLOW) as up, up.client():
        where = ("--connect", up.endpoint)
        assert zengrid("control", "pause", *where).stdout.startswith("paper (main): paused, 36000x")
        before = json.loads(zengrid("top", "--json", *where).stdout)
        assert zengrid("control", "speed", "max", *where).returncode == 0
        assert zengrid("control", "step", "5", *where).returncode == 0
        with MarketClient("main", up.endpoint) as client:
            up.status(
                client, lambda status: status.state == "paused" and status.totals.slots == before["totals"]["slots"] + 5
            )
        once = zengrid("top", "--once", *where).stdout
        assert "paper (main)" in once
        assert "p3" in once
        assert zengrid("control", "stop", *where).returncode == 0
        assert up.end() == 0


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("nowhere",), "scenario 'nowhere': cannot be read"),
        (("--policy", "magic"), "policy = magic"),
        (("--grid-policy", "fixed:cheap"), "cheap"),
        (("fontana",), "data"),
        (("--data", "/nonexistent", "fontana"), "/nonexistent"),
        (("--journal", "/nonexistent/journal.db"), "/nonexistent/journal.db"),
    ],
)
def test_a_user_error_is_one_clear_line(tmp_path: Path, options: tuple[str, ...], complaint: str) -> None:
    words = ("up", "--listen", "auto", "--no-http", "--logs", str(tmp_path), "--journal", str(tmp_path / "journal.db"))
    ended = zengrid(*words, *options)
    assert ended.returncode == 1
    assert complaint in ended.stderr
    assert "Traceback" not in ended.stderr + ended.stdout
    # On a slow machine the market is shown before its error is known.
    lines = [line for line in ended.stderr.splitlines() if " at tcp/" not in line]
    assert lines[0].startswith("zengrid up: ")
    assert len(lines) <= 2


def test_a_port_that_is_taken_is_named(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        zenoh = zengrid("up", "--listen", f"tcp/127.0.0.1:{port}", "--no-http")
        http = zengrid("up", "--listen", "auto", "--http", str(port))
    for ended, option in ((zenoh, "--listen"), (http, "--http")):
        assert ended.returncode == 1
        assert f"{option} " in ended.stderr
        assert "another process listens there" in ended.stderr
        assert len(ended.stderr.splitlines()) == 1


def test_the_table_is_drawn_on_a_terminal(tmp_path: Path) -> None:
    import pty

    controller, terminal = pty.openpty()
    words = ["up", *SLOW, "--listen", "auto", "--no-http", "--logs", str(tmp_path), "--journal", str(tmp_path / "j.db")]
    process = subprocess.Popen(
        [sys.executable, "-m", "zengrid_cli", *words],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
        env={**os.environ, "COLUMNS": "80", "LINES": "24", "TERM": "xterm-256color"},
    )
    os.close(terminal)
    with process:
        shown = b""
        while b"baseline" not in shown or b"p3" not in shown:
            shown += os.read(controller, 65536)
        process.send_signal(signal.SIGINT)
        ended = b""
        while True:
            try:
                data = os.read(controller, 65536)
            except OSError:
                break
            ended += data
        assert process.wait(DEADLINE_S) == 0
    os.close(controller)
    assert "●".encode() in shown
    assert b"reserve energy" in ended
    assert ended.rfind(b"\x1b[?25h") > ended.rfind(b"\x1b[?25l")
