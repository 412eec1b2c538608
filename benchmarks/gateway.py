"""What the gateway takes and gives while a market runs at full speed: prices, live streams, memory, stuck clients.

    python benchmarks/gateway.py --minutes 10

A market of the paper (clock, grid agent, three prosumers, journal on) runs as fast as it can; the gateway is one
process with one event loop. ``wrk`` (Debian: ``apt install wrk``) asks for the price; live streams are counted by a
client of this script, in a process of its own. Everything shares the machine: market, gateway and those who ask.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import platform
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

from zengrid.journal import Journal
from zengrid.testing import RunningMarket, free_port

POSITION = re.compile(rb"^id: (\d+)$", re.MULTILINE)


class Bench:
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
        """Rate of the market over some time."""
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
    """Follow the market with so many clients; tells now and then what the slowest of them has seen."""
    newest = [-1] * clients
    frames = 0
    everybody = asyncio.Event()

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
                    everybody.set()

    tasks = [asyncio.create_task(follow(index)) for index in range(clients)]
    await everybody.wait()
    frames, began = 0, time.monotonic()
    samples = []
    while time.monotonic() < began + seconds:
        await asyncio.sleep(0.1)
        samples.append((time.time(), min(newest)))
    for task in tasks:
        task.cancel()
    return {"frames_per_s": frames / seconds, "samples": samples}


def behind(journal: Path, samples: list[tuple[float, int]]) -> dict[str, float]:
    """How long ago the first slot that the slowest client has not seen was settled. [s]"""
    run = Journal.open(journal, read_only=True).run()
    settled = np.concatenate([block["settled_at"] for block in run.blocks(homes=False)])
    late = [max(now - settled[position + 1], 0.0) for now, position in samples if position + 1 < len(settled)]
    return {"behind_p50_s": float(np.median(late)), "behind_max_s": float(max(late))}


def watchers(port: int, clients: int, seconds: float) -> subprocess.Popen[str]:
    """The same in a process of its own."""
    command = [sys.executable, __file__, "--watch", str(port), str(clients), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def stuck(port: int, count: int) -> list[socket.socket]:
    """Clients that ask for the live stream and never read it."""
    clients = []
    for _ in range(count):
        client = socket.create_connection(("127.0.0.1", port))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.sendall(b"GET /v1/live HTTP/1.1\r\nHost: localhost\r\n\r\n")
        clients.append(client)
    return clients


def measure(seconds: float, minutes: float) -> dict[str, Any]:
    """All of it."""
    results: dict[str, Any] = {}
    with ExitStack() as stack:
        bench = Bench(stack)
        results["market_alone_slots_per_s"] = bench.slots_per_s(seconds)
        gateway = bench.start_gateway()
        results["market_with_gateway_slots_per_s"] = bench.slots_per_s(seconds)
        results["memory_at_start_mb"] = gateway.memory_info().rss / 2**20
        results["price"] = wrk(bench.url, 16, seconds)
        streams = watchers(bench.port, 500, seconds)
        time.sleep(2.0)
        results["market_with_500_streams_slots_per_s"] = bench.slots_per_s(seconds)
        seen = json.loads(streams.communicate()[0])
        late = behind(bench.market.journal, seen["samples"])
        results["streams"] = {"clients": 500, "frames_per_s": seen["frames_per_s"], **late}
        clients = stuck(bench.port, 50)
        results["price_beside_50_stuck_streams"] = wrk(bench.url, 16, seconds)
        results["memory_with_stuck_streams_mb"] = gateway.memory_info().rss / 2**20
        for client in clients:
            client.close()
        if results["price"]["errors"] or results["price_beside_50_stuck_streams"]["errors"]:
            raise SystemExit(f"some answers were errors:\n{json.dumps(results)}\n{bench.market.output()}")
        memory = []
        until = time.monotonic() + 60.0 * minutes
        while time.monotonic() < until:
            load = watchers(bench.port, 20, 4.0)
            wrk(bench.url, 4, 4.0)
            load.communicate()
            memory.append(gateway.memory_info().rss / 2**20)
        if memory:
            half = memory[len(memory) // 2]
            results["memory_over_time_mb"] = {"minutes": minutes, "first": memory[0], "half": half, "last": memory[-1]}
    alone = results["market_alone_slots_per_s"]
    results["market_kept_with_500_streams"] = results["market_with_500_streams_slots_per_s"] / alone
    return results


def main() -> None:
    """Measure, print, and write a JSON file."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seconds", type=float, default=10.0, help="of each measurement (default: %(default)g)")
    options.add_argument("--minutes", type=float, default=1.0, help="how long memory is watched (default: %(default)g)")
    options.add_argument("--out", type=Path, default=Path("benchmarks/results/gateway.json"))
    options.add_argument("--watch", nargs=3, metavar=("PORT", "CLIENTS", "SECONDS"), help=argparse.SUPPRESS)
    chosen = options.parse_args()
    if chosen.watch:
        port, clients, seconds = chosen.watch
        print(json.dumps(asyncio.run(watch(int(port), int(clients), float(seconds)))))
        return
    results = measure(chosen.seconds, chosen.minutes)
    machine = {"python": platform.python_version(), "cpus": psutil.cpu_count(), "system": platform.platform()}
    text = json.dumps({"machine": machine, "results": results}, indent=1)
    print(text)
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
