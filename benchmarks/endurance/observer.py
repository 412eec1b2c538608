"""What is seen of a market from outside while it runs: its public slots and its processes."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable
from typing import NamedTuple

import psutil

from kit.market import UpMarket
from zengrid.wire.codec import decode
from zengrid.wire.slots import PublicSlot

RECOVERY_S = 60.0
"""A fault from which the market has not recovered by then counts as a failure."""


class ObservedSlot(NamedTuple):
    """A public slot as it was received."""

    at: float
    """monotonic time [s]"""
    position: int
    buy_price: float
    demand_kw: float
    acted: frozenset[str]
    agents: frozenset[str]
    """all that take part, whether they acted or a fallback acted for them"""


class Sample(NamedTuple):
    """Resources of a process at a moment."""

    at: float
    """monotonic time [s]"""
    memory_mb: float
    handles: int


class Observer:
    """Public slots, processes and their resources of one market.

    Parameters
    ----------
    market:
        A market that runs.
    """

    def __init__(self, market: UpMarket) -> None:
        self.market = market
        self.slots: list[ObservedSlot] = []
        self.findings: list[str] = []
        """what is wrong with the public slots"""
        self.known: dict[int, psutil.Process] = {}
        """every process that was ever seen, by its id"""
        self.samples: dict[str, list[Sample]] = defaultdict(list)
        self._changed = threading.Condition()

    def on_slot(self, payload: bytes) -> None:
        """Keep a public slot; a restarted clock may publish its last one again."""
        slot = decode(PublicSlot, payload)
        acted = frozenset(slot.acted)
        with self._changed:
            if self.slots and slot.position <= self.slots[-1].position:
                if slot.position < self.slots[-1].position:
                    self.findings.append(f"slot {slot.position} was published after {self.slots[-1].position}")
                return
            agents = acted | frozenset(slot.fallback)
            self.slots.append(
                ObservedSlot(time.monotonic(), slot.position, slot.buy_price, slot.demand_kw, acted, agents)
            )
            self._changed.notify_all()

    def wait_for_slot(self, wanted: Callable[[ObservedSlot], bool], since: float) -> bool:
        """Wait for a slot received after ``since`` that fits a condition; False where none comes in time."""

        def arrived() -> bool:
            return bool(self.slots) and self.slots[-1].at > since and wanted(self.slots[-1])

        with self._changed:
            return self._changed.wait_for(arrived, RECOVERY_S)

    def processes(self) -> dict[str, psutil.Process]:
        """All processes of the market but the command itself, by title; those of a spawner end with their home's id."""
        found = {}
        for child in self.market.processes()[1:]:
            self.known[child.pid] = child
            try:
                found[" ".join(child.cmdline()).strip().removeprefix("zengrid ")] = child
            except psutil.Error:
                continue
        return found

    def process(self, title: str) -> psutil.Process:
        """A process by its title or home, waited for while it is being restarted."""
        until = time.monotonic() + RECOVERY_S
        while time.monotonic() < until:
            for name, process in self.processes().items():
                if name == title or name.endswith(f" {title}"):
                    return process
            time.sleep(0.05)
        raise RuntimeError(f"{title} does not run within {RECOVERY_S:g} s; running: {sorted(self.processes())}")

    def sample(self) -> None:
        """Take memory and file handles of every process."""
        for title, process in {"up": self.market.up, **self.processes()}.items():
            try:
                with process.oneshot():
                    memory_mb = process.memory_full_info().pss / 2**20
                    self.samples[title].append(Sample(time.monotonic(), memory_mb, process.num_fds()))
            except psutil.Error:
                continue

    def end_processes(self) -> list[str]:
        """Kill processes that outlived the market; returns a line for each."""
        psutil.wait_procs([process for process in self.known.values() if is_alive(process)], timeout=5)
        left = [process for process in self.known.values() if is_alive(process)]
        lines = [f"process {process.pid} is left: {' '.join(process.cmdline())}" for process in left]
        for process in left:
            process.kill()
        return lines


def is_alive(process: psutil.Process) -> bool:
    """Whether a process runs; a zombie does not."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
