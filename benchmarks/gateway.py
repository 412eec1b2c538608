"""Load on the gateway while a market runs at full speed: prices, live streams, memory, clients that do not read.

    python benchmarks/gateway.py
    nice -n 5 python benchmarks/gateway.py --seconds 3 --minutes 10

Claim: docs/measurements/performance.md ("The gateway").
Takes 2 minutes plus ``--minutes``; needs ``wrk`` (``apt install wrk``).

A market of the paper (clock, grid agent, three prosumers, journal on) runs at full speed; the gateway is one process
with one event loop. ``wrk`` requests the price; a process of this script counts what live streams deliver. Market,
gateway and clients share the machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import re
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil

from kit.script import parse_options, script_parser, write_results
from zengrid.journal import Journal
from zengrid.testing import RunningMarket, free_port

UNREAD = 50
"""Live streams that no client reads."""
POSITION = re.compile(rb"^id: (\d+)$", re.MULTILINE)


class MarketWithGateway:
    """A market at full speed with its gateway."""

    def __init__(self, stack: ExitStack) -> None:
        self.market = stack.enter_context(RunningMarket("paper"))
        self.market.start_agents("p1", "p2", "p3")
        self.market.wait_for_slots(100)
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"

    def start_gateway(self) -> psutil.Process:
        """Start it and wait until it shows the market."""
        where = ("--connect", self.market.endpoint, "--run", self.market.run, "--port", str(self.port))
        command = (sys.executable, "-m", "zengrid_gateway", *where, "--journal", str(self.market.journal))
        process = self.market.start("gateway", *command)
        for _ in range(1500):
            try:
                if httpx.get(f"{self.url}/readyz").status_code == 200:
                    return psutil.Process(process.popen.pid)
            except httpx.TransportError:
                pass
            time.sleep(0.02)
        raise SystemExit(f"the gateway did not start:\n{self.market.output()}")

    def slots_per_s(self, seconds: float) -> float:
        """Slots a second of the market over some time."""
        first, began = self.market.client.control("status", homes=False), time.perf_counter()
        time.sleep(seconds)
        last, ended = self.market.client.control("status", homes=False), time.perf_counter()
        assert first.last is not None
        assert last.last is not None
        return (last.last.position - first.last.position) / (ended - began)


def wrk(url: str, connections: int, seconds: float) -> dict[str, float]:
    """Requests a second, and latencies [ms]."""
    program = shutil.which("wrk")
    if program is None:
        raise SystemExit("wrk is missing: apt install wrk")
    command = [program, "-t1", f"-c{connections}", f"-d{seconds:g}s", "--latency", f"{url}/v1/price"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    scale = {"us": 1e-3, "ms": 1.0, "s": 1e3}
    latencies = {
        f"p{percent}_ms": float(value) * scale[unit]
        for percent, value, unit in re.findall(r"^\s+(50|90|99)%\s+([\d.]+)(us|ms|s)$", text, re.MULTILINE)
    }
    rate = re.search(r"Requests/sec:\s+([\d.]+)", text)
    assert rate is not None
    errors = re.search(r"Non-2xx or 3xx responses: (\d+)", text)
    return {"requests_per_s": float(rate[1]), **latencies, "errors": float(errors[1]) if errors else 0.0}


async def watch(port: int, clients: int, seconds: float) -> dict[str, Any]:
    """Follow the live stream with so many clients; samples the newest slot that all of them have seen."""
    newest = [-1] * clients
    frames = 0
    all_connected = asyncio.Event()

    async def follow(index: int) -> None:
        nonlocal frames
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(b"GET /v1/live HTTP/1.1\r\nHost: localhost\r\n\r\n")
        while chunk := await reader.read(2**16):
            found = POSITION.findall(chunk)
            if found:
                frames += 1
                newest[index] = int(found[-1])
                if min(newest) >= 0:
                    all_connected.set()

    tasks = [asyncio.create_task(follow(index)) for index in range(clients)]
    await all_connected.wait()
    frames, began = 0, time.monotonic()
    samples = []
    while time.monotonic() < began + seconds:
        await asyncio.sleep(0.1)
        samples.append((time.time(), min(newest)))
    for task in tasks:
        task.cancel()
    return {"frames_per_s": frames / seconds, "samples": samples}


def behind(journal: Path, samples: list[tuple[float, int]]) -> dict[str, float]:
    """Age of the oldest slot that the slowest client has not seen yet. [s]"""
    run = Journal.open(journal, read_only=True).run()
    settled = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
    late = [max(now - settled[position + 1], 0.0) for now, position in samples if position + 1 < len(settled)]
    return {"behind_p50_s": float(np.median(late)), "behind_max_s": float(max(late))}


def watchers(port: int, clients: int, seconds: float) -> subprocess.Popen[str]:
    """``watch`` in a process of its own, which prints its result as JSON."""
    command = [sys.executable, __file__, "--watch", str(port), str(clients), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def open_unread_streams(port: int, count: int) -> list[socket.socket]:
    """Clients that request the live stream and never read it."""
    clients = []
    for _ in range(count):
        client = socket.create_connection(("127.0.0.1", port))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(b"GET /v1/live HTTP/1.1\r\nHost: localhost\r\n\r\n")
        clients.append(client)
    return clients


def measure(seconds: float, minutes: float, clients: int) -> dict[str, Any]:
    """Run a market with its gateway and put all kinds of load on it, one after the other."""
    results: dict[str, Any] = {}
    with ExitStack() as stack:
        bench = MarketWithGateway(stack)
        results["market_alone_slots_per_s"] = bench.slots_per_s(seconds)
        gateway = bench.start_gateway()
        results["market_with_gateway_slots_per_s"] = bench.slots_per_s(seconds)
        results["memory_at_start_mb"] = memory_mb(gateway)
        results["price"] = wrk(bench.url, 16, seconds)
        results |= measure_streams(bench, seconds, clients)
        unread = open_unread_streams(bench.port, UNREAD)
        results["price_beside_unread_streams"] = wrk(bench.url, 16, seconds)
        results["memory_with_unread_streams_mb"] = memory_mb(gateway)
        for client in unread:
            client.close()
        if results["price"]["errors"] or results["price_beside_unread_streams"]["errors"]:
            raise SystemExit(f"some responses were errors:\n{json.dumps(results)}\n{bench.market.output()}")
        results["memory_over_time_mb"] = watch_memory(bench, gateway, minutes)
    alone = results["market_alone_slots_per_s"]
    results["market_kept_with_streams"] = results["market_with_streams_slots_per_s"] / alone
    return results


def measure_streams(bench: MarketWithGateway, seconds: float, clients: int) -> dict[str, Any]:
    """Speed of the market and delay of the slowest client, with so many live streams."""
    streams = watchers(bench.port, clients, seconds)
    time.sleep(2.0)
    slots_per_s = bench.slots_per_s(seconds)
    seen = json.loads(streams.communicate()[0])
    late = behind(bench.market.journal, seen["samples"])
    return {
        "market_with_streams_slots_per_s": slots_per_s,
        "streams": {"clients": clients, "frames_per_s": seen["frames_per_s"], **late},
    }


def watch_memory(bench: MarketWithGateway, gateway: psutil.Process, minutes: float) -> dict[str, float]:
    """Memory at the beginning, in the middle and at the end of some minutes of requests and streams. [MiB]"""
    memory: list[float] = []
    until = time.monotonic() + 60.0 * minutes
    while not memory or time.monotonic() < until:
        load = watchers(bench.port, 20, 4.0)
        wrk(bench.url, 4, 4.0)
        load.communicate()
        memory.append(memory_mb(gateway))
    return {"minutes": minutes, "first": memory[0], "half": memory[len(memory) // 2], "last": memory[-1]}


def memory_mb(process: psutil.Process) -> float:
    """Resident memory. [MiB]"""
    return float(process.memory_info().rss) / 2**20


def main() -> None:
    """Measure, print, write the figures."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement (default: %(default)g)")
    parser.add_argument("--minutes", type=float, default=1.0, help="how long memory is watched (default: %(default)g)")
    parser.add_argument("--clients", type=int, default=500, help="live streams (default: %(default)s)")
    parser.add_argument("--watch", nargs=3, metavar=("PORT", "CLIENTS", "SECONDS"), help=argparse.SUPPRESS)
    options = parse_options(parser, {"seconds": 1.0, "minutes": 0.1, "clients": 20})
    if options.watch:
        port, clients, seconds = options.watch
        print(json.dumps(asyncio.run(watch(int(port), int(clients), float(seconds)))))
        return
    results = measure(options.seconds, options.minutes, options.clients)
    print(json.dumps(results, indent=1))
    write_results(options.out, results=results)


if __name__ == "__main__":
    main()
