"""A market as users run it, ``zengrid up``, measured from outside."""

from __future__ import annotations

import contextlib
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import psutil
import yaml

from kit.rounds import Row
from zengrid.bus.market_client import MarketClient
from zengrid.errors import BusError
from zengrid.journal import Journal
from zengrid.scenario import dumps, load
from zengrid.testing import free_endpoint
from zengrid.wire.queries import Status

START_S = 120.0
"""How long a market may take to settle its first slots. [s]"""


class UpMarket:
    """``zengrid up`` in a folder of its own. Use it with ``with``; its processes are gone at the end.

    Parameters
    ----------
    scenario:
        Built-in scenario or path.
    folder:
        An existing folder for the journal, logs and output.
    options:
        More options for ``zengrid up``.
    certs:
        Folder of certificates; None runs without TLS.
    """

    def __init__(self, scenario: str, folder: Path, *options: str, certs: Path | None = None) -> None:
        self.endpoint, self.certs = free_endpoint(), certs
        self.journal, self.output = folder / "journal.db", folder / "up.txt"
        self.command = [sys.executable, "-m", "zengrid_cli", "up", scenario, "--quiet", "--listen", self.endpoint]
        self.command += ["--journal", str(self.journal), "--logs", str(folder / "logs"), *options]
        self.command += [] if certs is None else ["--certs", str(certs)]

    def __enter__(self) -> Self:
        self.began = time.time()
        with self.output.open("wb") as output:
            self.up = psutil.Popen(self.command, stdout=output, stderr=output, start_new_session=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process in self.processes():
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        self.up.wait()

    def printed(self) -> str:
        """What the command has printed."""
        return self.output.read_text(errors="replace")

    def client(self) -> MarketClient:
        """An operator of this market."""
        return MarketClient("main", self.endpoint, certs=self.certs, timeout_s=START_S)

    def processes(self) -> list[psutil.Process]:
        """The command itself and all its children."""
        try:
            return [self.up, *self.up.children(recursive=True)]
        except psutil.NoSuchProcess:
            return [self.up]

    def wait_for_slots(self, client: MarketClient, slots: int) -> Status:
        """Wait until so many slots are settled; a clock that has just begun to listen may not answer yet."""
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            with contextlib.suppress(BusError):
                status = client.control("status", homes=False)
                if status.totals.slots >= slots:
                    return status
            time.sleep(0.01)
        raise SystemExit(f"zengrid up has not settled {slots} slots within {START_S:g} s:\n{self.printed()}")

    def wait_for_end(self, timeout_s: float = 60.0) -> None:
        """Wait until it has ended, without error."""
        code = self.up.wait(timeout_s)
        if code:
            raise SystemExit(f"zengrid up ended with exit code {code}:\n{self.printed()}")


def measure_up(
    scenario: str, seconds: float, *options: str, warm_slots: int = 50, certs: Path | None = None
) -> tuple[Row, list[float]]:
    """Run a market at full speed, without a page, and measure it between two looks of an operator.

    Parameters
    ----------
    scenario:
        Built-in scenario or path.
    seconds:
        How long to measure. [s]
    options:
        More options for ``zengrid up``, such as policies.
    warm_slots:
        Slots that do not count: profiles, the journal's first pages, Python's caches.
    certs:
        Folder of certificates; None runs without TLS.

    Returns
    -------
    row, profits:
        Figures with their units in their names, and the grid's profit of every slot [$].
    """
    with tempfile.TemporaryDirectory(prefix="zengrid-benchmark-") as name:
        market = UpMarket(scenario, Path(name), "--no-http", *options, certs=certs)
        with market:
            with market.client() as client:
                first = market.wait_for_slots(client, warm_slots)
            processes = market.processes()
            used_s, begin = -cpu_s(processes), time.monotonic()
            time.sleep(seconds)
            used_s += cpu_s(processes)
            measured_s = time.monotonic() - begin
            with market.client() as client:
                last = client.control("status", homes=False)
                memory_mb = sum(process.memory_full_info().pss for process in processes) / 2**20
                client.control("stop")
            market.wait_for_end()
        with Journal.open(market.journal, read_only=True) as journal:
            blocks = list(journal.run().blocks(homes=False))
        times = np.concatenate([block["settled_at"] for block in blocks])
        profits: list[float] = np.concatenate([block["profit"] for block in blocks]).tolist()
        # Without what an operator's joining and leaving cost.
        start, end = first.totals.slots, last.totals.slots - 1
        slots_s = (end - start) / float(times[end] - times[start])
        stored = sum(path.stat().st_size for path in (market.journal, Path(f"{market.journal}-wal")) if path.exists())
        return {
            "slots_s": slots_s,
            "cpu_ms": 1e3 * used_s / (slots_s * measured_s),
            "first_slot_s": float(times[0]) - market.began,
            "price_p50_ms": last.latency.price_p50_ms,
            "price_p99_ms": last.latency.price_p99_ms,
            "battery_p50_ms": last.latency.battery_p50_ms,
            "battery_p99_ms": last.latency.battery_p99_ms,
            "commit_p50_ms": last.latency.commit_p50_ms,
            "memory_mb": memory_mb,
            "journal_bytes_per_slot": stored / len(times),
            "fallbacks": float(sum(agent.fallbacks for agent in last.agents)),
        }, profits


def paper_with(homes: int, folder: Path) -> str:
    """The scenario ``paper``, with its three homes in turn until there are enough; written to a folder where needed."""
    if homes == 3:
        return "paper"
    body = yaml.safe_load(dumps(load("paper")))
    body["homes"] = [{**body["homes"][i % 3], "id": f"p{i + 1}"} for i in range(homes)]
    path = folder / f"paper{homes}.yaml"
    path.write_text(yaml.safe_dump(body), encoding="utf-8")
    return str(path)


def cpu_s(processes: list[psutil.Process]) -> float:
    """CPU time of processes so far. [s]"""
    return float(sum(sum(process.cpu_times()[:2]) for process in processes))
