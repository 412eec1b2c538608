"""A test kit: a real market of real processes over real Zenoh, for zengrid's tests and for those of your own agents."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from zengrid.bus.market_client import MarketClient
from zengrid.errors import ZengridError
from zengrid.wire.codec import decode
from zengrid.wire.queries import Status
from zengrid.wire.slots import PublicSlot

T = TypeVar("T")


def free_port() -> int:
    """A TCP port on loopback that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def free_endpoint() -> str:
    """A Zenoh endpoint on loopback that nobody uses at the moment."""
    return f"tcp/127.0.0.1:{free_port()}"


class Process:
    """A child process whose output is kept and shown when something goes wrong."""

    def __init__(self, name: str, command: Sequence[str], folder: Path, env: Mapping[str, str]) -> None:
        self.name = name
        self.log = folder / f"{name}-{time.monotonic_ns()}.log"
        with self.log.open("wb") as log:
            self.popen = subprocess.Popen(
                list(command),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1", **env},
            )

    def signal(self, number: int) -> None:
        """Send a signal."""
        self.popen.send_signal(number)

    def kill(self) -> None:
        """SIGKILL, and wait until it is gone."""
        self.popen.kill()
        self.popen.wait()

    def end(self, timeout_s: float = 60.0) -> int:
        """Wait for the process to end by itself; returns its exit code."""
        try:
            return self.popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"{self.name} did not end within {timeout_s:g} s:\n{self.output()}") from None

    def output(self) -> str:
        """What it has printed so far."""
        return self.log.read_text(errors="replace")


class RunningMarket:
    """A market of processes. Use it with ``with``; all of them are gone at the end.

    Parameters
    ----------
    scenario:
        Built-in scenario or path.
    options:
        More options for the clock, such as ``("--days", "2")``.
    run:
        Its name.
    certs:
        Folder of certificates (``zengrid certs``); without one nobody is authenticated.
    """

    def __init__(
        self, scenario: str = "paper", options: Sequence[str] = (), run: str = "test", certs: Path | None = None
    ) -> None:
        self.scenario = scenario
        self.options = [str(option) for option in options]
        self.run = run
        self.certs = certs
        self.endpoint = free_endpoint() if certs is None else f"tls/127.0.0.1:{free_port()}"
        self.processes: dict[str, Process] = {}
        self.last: PublicSlot | None = None
        self._changed = threading.Condition()

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="zengrid-test-")
        self.folder = Path(self._folder.name)
        self.journal = self.folder / "journal.db"
        try:
            self.start_clock()
            self.client = MarketClient(self.run, self.endpoint, certs=self.certs, timeout_s=20.0)
        except BaseException as error:
            self._close()
            raise AssertionError(f"the market did not start: {error}\n{self.output()}") from error
        self._following = self.client.follow(self._on_slot)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.client.session.close()
        if isinstance(error, (AssertionError, ZengridError)):
            error.add_note(self.output())
        self._close()

    def _close(self) -> None:
        for process in self.processes.values():
            if process.popen.poll() is None:
                process.signal(signal.SIGCONT)
                process.kill()
        self._folder.cleanup()

    def output(self) -> str:
        """What all processes have printed."""
        return "\n".join(f"--- {p.name} (exit code {p.popen.poll()})\n{p.output()}" for p in self.processes.values())

    def start(self, name: str, *command: str) -> Process:
        """Start a program of your own; its environment names the market.

        ``ZENGRID_CONNECT`` and ``ZENGRID_RUN``, and ``ZENGRID_CERTS`` where the market needs certificates.
        """
        if name in self.processes and self.processes[name].popen.poll() is None:
            raise ValueError(f"name = {name}: a process of this name runs; give it another name")
        where = {"ZENGRID_CONNECT": self.endpoint, "ZENGRID_RUN": self.run}
        if self.certs is not None:
            where["ZENGRID_CERTS"] = str(self.certs)
        self.processes[name] = process = Process(name, command, self.folder, where)
        return process

    def _start(self, name: str, module: str, *arguments: str) -> Process:
        return self.start(name, sys.executable, "-m", module, *arguments)

    def start_clock(self, *options: str) -> Process:
        """Start the clock; with ``--resume`` it goes on with the journal of an earlier one."""
        arguments = [self.scenario, "--journal", str(self.journal), "--listen", self.endpoint, "--run", self.run]
        return self._start("clock", "zengrid_clock", *arguments, *self.options, *options)

    def start_grid(self, *options: str) -> Process:
        """Start the grid agent."""
        return self._start("grid", "zengrid_agent", "grid", *options)

    def start_prosumer(self, agent: str, *options: str, name: str | None = None) -> Process:
        """Start a prosumer agent."""
        return self._start(name or agent, "zengrid_agent", "prosumer", "--id", agent, *options)

    def start_agents(self, *prosumers: str, policy: str = "conventional", grid_policy: str = "fixed") -> None:
        """Start the grid agent and some prosumers."""
        self.start_grid("--policy", grid_policy)
        for agent in prosumers:
            self.start_prosumer(agent, "--policy", policy)

    def _on_slot(self, payload: bytes) -> None:
        with self._changed:
            self.last = decode(PublicSlot, payload)
            self._changed.notify_all()

    def wait_for_slot(
        self, wanted: Callable[[PublicSlot], bool] | int, timeout_s: float = 60.0, missing: str = "the slot"
    ) -> PublicSlot:
        """Wait for a settled slot: from a journal position on, or one that fits a condition."""
        condition = (lambda slot: slot.position >= wanted) if isinstance(wanted, int) else wanted

        def arrived() -> PublicSlot | None:
            return self.last if self.last is not None and condition(self.last) else None

        with self._changed:
            found = self._changed.wait_for(arrived, timeout_s)
        if found is None:
            raise AssertionError(
                f"{missing} did not come within {timeout_s:g} s; last was {self.last}\n{self.output()}"
            )
        return found

    def wait_for_slots(self, count: int, timeout_s: float = 60.0) -> PublicSlot:
        """Wait until so many more slots are settled."""
        start = -1 if self.last is None else self.last.position
        return self.wait_for_slot(start + count, timeout_s, f"slot {start + count}")

    def wait_for_status(
        self, wanted: Callable[[Status], bool], timeout_s: float = 60.0, missing: str = "the state"
    ) -> Status:
        """Wait for a state of the market: looked at again after each settled slot, or every 50 ms without one."""
        until = time.monotonic() + timeout_s
        while True:
            status = self.client.control("status")
            if wanted(status):
                return status
            if time.monotonic() > until:
                raise AssertionError(
                    f"{missing} did not come within {timeout_s:g} s; last was {status}\n{self.output()}"
                )
            with self._changed:
                self._changed.wait(0.05)
