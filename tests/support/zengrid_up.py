"""``zengrid up`` as a user starts it: a process in a folder of its own, with all its children."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import psutil

from zengrid.bus.market_client import MarketClient
from zengrid.errors import ZengridError
from zengrid.testing import Process, free_endpoint
from zengrid.wire.queries import Status

DEADLINE_S = 30.0


class ZengridUp:
    """A market on this machine. Use it with ``with``; nothing is left at the end."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        self.endpoint = free_endpoint()
        http = () if "--http" in options else ("--no-http",)
        # Logs are the only thing it writes that is not named here.
        self.journal = folder / "journal.db"
        words = ["up", *options, *http, "--listen", self.endpoint, "--journal", str(self.journal)]
        command = [sys.executable, "-m", "zengrid_cli", *words, "--logs", str(folder / "runs")]
        self.process = Process("up", command, folder, {})
        self.me = psutil.Process(self.process.popen.pid)
        self._seen: dict[int, psutil.Process] = {}
        self.patience_s = DEADLINE_S

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self.children()
        if self.process.popen.poll() is None:
            self.process.kill()
        if isinstance(error, (AssertionError, ZengridError)):
            error.add_note(self.output())
        for child in self.left():
            child.kill()

    def output(self) -> str:
        """What it and its children have printed."""
        logs = sorted((self.folder / "runs").glob("*/*.log"))
        return "\n".join([self.process.output(), *(f"--- {log.name}\n{log.read_text()}" for log in logs)])

    def children(self) -> dict[str, psutil.Process]:
        """All processes it runs now, by what ``ps`` shows."""
        found: dict[str, psutil.Process] = {}
        try:
            for child in self.me.children():
                self._seen[child.pid] = child
                found[" ".join(child.cmdline()).strip()] = child
        except psutil.NoSuchProcess:
            pass
        return found

    def left(self) -> list[psutil.Process]:
        """Those processes it ever ran (as far as they were looked at) that are still alive."""
        return [child for child in self._seen.values() if child.is_running() and child.status() != psutil.STATUS_ZOMBIE]

    def until(self, condition: Callable[[], object], missing: str) -> None:
        """Wait for something to happen, looking 50 times a second."""
        deadline = time.monotonic() + self.patience_s
        while not condition():
            assert time.monotonic() < deadline, f"in vain: {missing}"
            assert self.process.popen.poll() is None, f"ended before: {missing}"
            time.sleep(0.02)

    def child(self, title: str, not_pid: int = 0) -> psutil.Process:
        """Wait for a process by what ``ps`` shows, and another one than that."""
        found: list[psutil.Process] = []

        def there() -> bool:
            child = self.children().get(title)
            if child is not None and child.pid != not_pid:
                found.append(child)
            return bool(found)

        self.until(there, f"{title} other than {not_pid}")
        return found[0]

    def client(self) -> MarketClient:
        """A session to ask the clock; the market is running when this returns."""
        client = MarketClient("main", self.endpoint, timeout_s=DEADLINE_S)
        self.status(client, lambda status: status.state == "running" and status.last is not None)
        return client

    def status(self, client: MarketClient, wanted: Callable[[Status], bool]) -> Status:
        """Wait for a state of the market, also while its clock is away."""
        found: list[Status] = []

        def looks_so() -> bool:
            try:
                status = client.control("status")
            except ZengridError:
                return False
            found[:] = [status]
            return wanted(status)

        self.until(looks_so, f"a state of the market; last was {found}")
        return found[0]

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        os.kill(self.me.pid, number)

    def end(self) -> int:
        """Wait for its end; returns the exit code."""
        return self.process.end(DEADLINE_S)
