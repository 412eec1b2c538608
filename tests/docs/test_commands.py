"""Commands and Python examples in the documentation run as they stand there, and say what the page shows.

Each page gets an empty folder and a free port. Commands that go on until Ctrl-C are left running until the page ends or
starts another market; all others must end by themselves, without error.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.doc_pages import ROOT, Block, blocks
from zengrid.bus.market_client import MarketClient
from zengrid.errors import BusError
from zengrid.testing import free_endpoint, free_port

PAGES = [
    "README.md",
    "docs/getting-started.md",
    "docs/http.md",
    "docs/journal.md",
    "docs/operating.md",
    "docs/own-agent.md",
    "docs/scenarios.md",
    "docs/security.md",
    "docs/several-machines.md",
]
LEARNING = ["docs/learning.md", "docs/learning-live.md", "docs/own-algorithm.md", "docs/own-data.md"]
ELSEWHERE = {
    "make": "installs; `make up` is taken for the command that it ends with",
    "source": "the environment is active already",
    "pip": "installs",
    "sudo": "measures, for minutes",
    "zenohd": "is no Python package",
}
CONTAINERS = {"docker": "needs Docker", "kubectl": "needs a cluster"}
"""And so does whatever stands in the same block."""
NEEDS = {
    "citylearn_challenge_2022_phase_all": "data that is not part of zengrid",
    "192.0.2.10": "another machine",
    "router.example": "another machine",
    "my-market.yaml": "a file of the reader's",
    "market-1": "a run of the reader's",
    "away|back": "a process that was killed",
}
ENDS_S = 120.0
LEARNS_S = 600.0
"""For what trains, or searches for a leader reference."""
SLOTS = 1_000
"""Of the example with Stable-Baselines3: enough to see it work."""


def commands(block: Block) -> Iterator[tuple[str, str]]:
    """Commands of a block in order, each with what the page says it prints; none where containers are needed."""
    parts = [part.partition("\n") for part in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]]
    if not any(command.split()[0] in CONTAINERS for command, _, _ in parts):
        yield from ((command, shown) for command, _, shown in parts)


class Terminal:
    """Where commands of one page are typed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.http = free_port()
        self.running: list[tuple[str, subprocess.Popen[bytes]]] = []
        (folder / "docs").symlink_to(ROOT / "docs")
        self.begin()

    def begin(self) -> None:
        """Another market: those before it have ended."""
        self.endpoint = free_endpoint()
        where = {"ZENGRID_LISTEN": self.endpoint, "ZENGRID_CONNECT": self.endpoint}
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self.env = {**os.environ, **where, "PATH": path, "COLUMNS": "100"}

    def type(self, command: str, shown: str) -> None:
        """Run one command."""
        command = re.sub(r"^make up(?: ARGS=\"(.*)\")?", r"zengrid up \1", command)
        command = command.removeprefix("nohup ")  # here nobody hangs up
        words = shlex.split(command, comments=True)
        while "=" in words[0]:  # a setting for this command alone
            words.pop(0)
        if words[0] in ELSEWHERE or any(need in command for need in NEEDS):
            return
        if words[0] == "curl" and shutil.which("curl") is None:
            return
        if words[:2] in (["zengrid", "up"], ["zengrid", "clock"]):
            self.end()
            self.begin()
        command = command.replace("localhost:8080", f"127.0.0.1:{self.http}")
        if words[:2] == ["zengrid", "up"] and "--no-http" not in words:
            command = command.replace("zengrid up", f"zengrid up --http {self.http}", 1)
        background = words[-1] == "&" or goes_on(words)
        if background:
            self.start(command.partition("#")[0].rstrip(" &"), words)
            return
        learns = words[1] in ("train", "evaluate") or "--learn" in words or "train_with_sb3" in command
        command = re.sub(r"(train_with_sb3\.py)$", rf"\1 {SLOTS}", command)
        compare(shown, self.run("bash", "-c", command, ends_s=LEARNS_S if learns else ENDS_S))

    def run(self, *words: str, ends_s: float = ENDS_S) -> str:
        """Run a program until it ends; what it printed."""
        ended = subprocess.run(words, cwd=self.folder, env=self.env, capture_output=True, text=True, timeout=ends_s)
        assert ended.returncode == 0, f"$ {words[-1]}\n{ended.stdout}{ended.stderr}\n{self.logs()}"
        return ended.stdout

    def start(self, command: str, words: list[str]) -> None:
        """Run a command until the page ends; wait until it does what it is for."""
        log = self.folder / f"command-{len(self.running)}.log"
        with log.open("wb") as out:
            process = subprocess.Popen(
                ["bash", "-c", re.sub(r"^((?:\w+=\S+ )*)", r"\1exec ", command)],
                cwd=self.folder,
                env=self.env,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.running.append((command, process))
        if words[1] == "up":
            self.wait(command, lambda: self.price() is not None)
        elif "--id" in words and words[-1] != "&":
            self.wait(command, lambda: self.acts(words[words.index("--id") + 1]))
        elif words[0] == "python":
            self.wait(command, lambda: self.acts(words[2]))

    def price(self) -> object:
        """What the gateway answers, once it is there."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.http}/v1/price", timeout=5.0) as answer:
                return json.load(answer)
        except OSError:
            return None

    def acts(self, agent: str) -> bool:
        """Whether an agent's actions count."""
        try:
            with MarketClient("main", self.endpoint) as client:
                return any(found.id == agent and found.acted for found in client.control("status").agents)
        except BusError:
            return False

    def wait(self, command: str, done: Callable[[], bool]) -> None:
        """Look until it is done."""
        until = time.monotonic() + ENDS_S
        while not done():
            assert time.monotonic() < until, f"$ {command}\nhas no effect\n{self.logs()}"
            time.sleep(0.1)

    def end(self) -> None:
        """Ctrl-C for everything, the last first; none of them may take that ill."""
        while self.running:
            command, process = self.running.pop()
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
            # The others: it was about to begin, or to end, when the signal came.
            assert process.wait(ENDS_S) in (0, 130, -signal.SIGINT), f"$ {command}\n{self.logs()}"

    def kill(self) -> None:
        """Leave nothing behind."""
        for _, process in self.running:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def logs(self) -> str:
        """What commands in the background have said."""
        return "\n".join(path.read_text(errors="replace") for path in self.folder.glob("**/*.log"))


def goes_on(words: list[str]) -> bool:
    """Whether a command goes on until Ctrl-C."""
    if words[:2] == ["python", "docs/examples/own_agent.py"]:
        return len(words) > 3  # it has brought a home to a market that goes on
    if words[0] != "zengrid" or words[1] == "up":
        return words[0] == "zengrid" and "--days" not in words
    return words[1] in ("prosumer", "grid", "clock", "gateway") or words[1:] == ["top"]


@contextmanager
def terminal(folder: Path) -> Iterator[Terminal]:
    it = Terminal(folder)
    try:
        yield it
        it.end()
    finally:
        it.kill()


def compare(shown: str, printed: str) -> None:
    """JSON must have the same names, lines the same words; numbers and states differ from run to run."""
    if shown.startswith("{"):
        assert json.loads(printed).keys() == json.loads(shown).keys()
        return
    lines = [without_numbers(line) for line in printed.splitlines()]
    for line in shown.splitlines():
        assert without_numbers(line) in lines, printed


def without_numbers(line: str) -> str:
    return re.sub(r"[-+]?[\d.,:]+", "#", " ".join(line.split()))


@pytest.mark.slow
@pytest.mark.timeout(2400)
@pytest.mark.parametrize("page", LEARNING)
def test_commands_that_learn_do_what_the_page_says(page: str, tmp_path: Path) -> None:
    for module in ("torch", "stable_baselines3"):
        pytest.importorskip(module, reason="needs extras learn and dev")
    test_commands_do_what_the_page_says(page, tmp_path)


@pytest.mark.parametrize("page", PAGES)
def test_commands_do_what_the_page_says(page: str, tmp_path: Path) -> None:
    with terminal(tmp_path) as it:
        for block in blocks(page, "console", "python"):
            if block.language == "console":
                for command, shown in commands(block):
                    it.type(command, shown)
            elif not block.title:
                printed = it.run(sys.executable, "-c", block.text)
                assert block.shown in (None, printed)
