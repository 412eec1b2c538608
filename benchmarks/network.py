"""What distance costs: slots a second and fallbacks of a market whose agents are on another machine.

    sudo python benchmarks/network.py

The other machine is a network namespace at the end of a cable with latency and loss, without ``tc netem``
(``tests/support/network_hosts.py``). All four agents of the paper's market are there, with certificates; clock and
journal are here.
Last, the cable is cut for a while.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.certificate_folders import make_certs
from support.network_hosts import NetworkHosts, why_not
from zengrid.testing import RunningMarket, free_port
from zengrid.wire.queries import Status

CABLES = ((0, 0), (1, 0), (5, 0), (20, 0), (50, 0), (100, 0), (20, 1), (20, 5), (100, 1))
"""Round trip [ms] and loss each way [%]."""
AGENTS = ("grid", "p1", "p2", "p3")
CUT_S = 10.0

Row = dict[str, Any]


def status(market: RunningMarket) -> tuple[float, Status]:
    """How the market stands, and when."""
    return time.monotonic(), market.client.control("status", homes=False)


def between(before: tuple[float, Status], after: tuple[float, Status]) -> Row:
    """Slots a second and the share of answers that did not come in time."""
    slots = after[1].totals.slots - before[1].totals.slots
    missed = sum(agent.fallbacks for agent in after[1].agents) - sum(agent.fallbacks for agent in before[1].agents)
    return {
        "slots": slots,
        "slots_s": slots / (after[0] - before[0]),
        "fallback_share": missed / max(slots * len(AGENTS), 1),
    }


def everyone(market: RunningMarket) -> None:
    """Wait for a slot in which all agents acted."""
    market.wait_for_slot(lambda slot: set(AGENTS) <= set(slot.acted), 60, "a slot of everyone")


def one_round(hosts: NetworkHosts, market: RunningMarket, seconds: float) -> list[Row]:
    """All cables in turn, then the cut."""
    rows: list[Row] = []
    for round_trip_ms, loss_percent in CABLES:
        hosts.quality("there", round_trip_ms / 2000, loss_percent / 100)
        everyone(market)
        before = status(market)
        time.sleep(seconds)
        rows.append({"round_trip_ms": round_trip_ms, "loss_percent": loss_percent, **between(before, status(market))})
        print(rows[-1], file=sys.stderr)
    hosts.quality("there", 0.01)
    everyone(market)
    before = status(market)
    hosts.cut("there")
    time.sleep(CUT_S)
    row = between(before, status(market))
    hosts.quality("there", 0.01)
    mended = time.monotonic()
    everyone(market)
    rows.append({"round_trip_ms": 20, "cut_s": CUT_S, **row, "back_after_s": time.monotonic() - mended})
    print(rows[-1], file=sys.stderr)
    return rows


def table(rounds: list[list[Row]]) -> str:
    """Markdown: medians of the rounds, and the slowest and fastest."""
    lines = ["| round trip | loss each way | slots/s (min-max) | answers that came too late |", "|---|---|---|---|"]
    for same in zip(*rounds, strict=True):
        numbers = ("slots_s", "fallback_share", "back_after_s")
        row = same[0] | {name: statistics.median(one[name] for one in same) for name in numbers if name in same[0]}
        speeds = [one["slots_s"] for one in same]
        loss = f"cut for {row['cut_s']:g} s" if "cut_s" in row else f"{row['loss_percent']} %"
        back = f"; everyone back {row['back_after_s']:.1f} s after it was mended" if "back_after_s" in row else ""
        late = f"{100 * row['fallback_share']:.1f} %{back}"
        speed = f"{row['slots_s']:.1f} ({min(speeds):.1f}-{max(speeds):.1f})"
        lines.append(f"| {row['round_trip_ms']} ms | {loss} | {speed} | {late} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print the table, write the figures."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seconds", type=float, default=10.0, help="for each cable")
    options.add_argument("--rounds", type=int, default=3, help="of all cables")
    options.add_argument("--deadline", type=float, default=2.0, help="of a phase [s]")
    options.add_argument("--out", type=Path, default=Path("benchmarks/results/network.json"))
    chosen = options.parse_args()
    reason = why_not()
    if reason is not None:
        raise SystemExit(f"network.py: {reason}")
    with tempfile.TemporaryDirectory() as name, NetworkHosts("there") as hosts:
        with contextlib.redirect_stdout(sys.stderr):
            certs = make_certs(Path(name) / "certs", "--host", hosts.here)
        market = RunningMarket("paper", ("--deadline", str(chosen.deadline), "--wait", "60"), certs=certs)
        market.endpoint = f"tls/{hosts.here}:{free_port()}"
        with market:
            for agent in AGENTS:
                words = ["grid"] if agent == "grid" else ["prosumer", "--id", agent]
                market.start(agent, *hosts.on("there", sys.executable, "-m", "zengrid_agent", *words))
            rounds = [one_round(hosts, market, chosen.seconds) for _ in range(chosen.rounds)]
    machine = {"cpus": os.cpu_count(), "platform": platform.platform(), "python": platform.python_version()}
    chosen.out.parent.mkdir(parents=True, exist_ok=True)
    chosen.out.write_text(
        json.dumps({"machine": machine, "deadline_s": chosen.deadline, "rounds": rounds}, indent=1) + "\n"
    )
    print(table(rounds))


if __name__ == "__main__":
    main()
