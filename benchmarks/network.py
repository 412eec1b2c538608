"""Slots a second and fallbacks of a market whose agents are on another machine, by latency and loss.

    sudo python benchmarks/network.py --rounds 3 --seconds 6

Claim: docs/measurements/network.md ("Distance"). Takes 5 minutes; needs root, the command ``ip`` and
/dev/net/tun.

The other machine is a network namespace at the end of a cable with latency and loss (tests/support/network_hosts.py; no
``tc netem`` needed). All four agents of the paper's market are there, with certificates; clock and journal are here.
At the end of a round the cable is cut for a while.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from kit.rounds import markdown, median, median_and_range
from kit.script import ROOT, parse_options, script_parser, write_results

sys.path.append(str(ROOT / "tests"))
from support.certificate_folders import make_certs
from support.network_hosts import NetworkHosts, why_not
from zengrid.testing import RunningMarket, free_port
from zengrid.wire.queries import Status

CABLES = ((0, 0), (1, 0), (5, 0), (20, 0), (50, 0), (100, 0), (20, 1), (20, 5), (100, 1))
"""Round trip [ms] and loss each way [%]."""
AGENTS = ("grid", "p1", "p2", "p3")

Row = dict[str, Any]


def status(market: RunningMarket) -> tuple[float, Status]:
    """The state of the market, and when it was asked for. [s]"""
    return time.monotonic(), market.client.control("status", homes=False)


def between(before: tuple[float, Status], after: tuple[float, Status]) -> Row:
    """Slots a second, and the share of actions that did not come in time."""
    slots = after[1].totals.slots - before[1].totals.slots
    missed = sum(agent.fallbacks for agent in after[1].agents) - sum(agent.fallbacks for agent in before[1].agents)
    return {
        "slots": slots,
        "slots_s": slots / (after[0] - before[0]),
        "fallback_share": missed / max(slots * len(AGENTS), 1),
    }


def wait_for_all_agents(market: RunningMarket) -> None:
    """Wait for a slot in which all agents acted."""
    market.wait_for_slot(lambda slot: set(AGENTS) <= set(slot.acted), 60, "a slot in which all agents acted")


def one_round(hosts: NetworkHosts, market: RunningMarket, seconds: float, cut_s: float) -> list[Row]:
    """All cables in turn, then the cut."""
    rows: list[Row] = []
    for round_trip_ms, loss_percent in CABLES:
        hosts.quality("there", round_trip_ms / 2000, loss_percent / 100)
        wait_for_all_agents(market)
        before = status(market)
        time.sleep(seconds)
        rows.append({"round_trip_ms": round_trip_ms, "loss_percent": loss_percent, **between(before, status(market))})
        print(rows[-1], file=sys.stderr)
    hosts.quality("there", 0.01)
    wait_for_all_agents(market)
    before = status(market)
    hosts.cut("there")
    time.sleep(cut_s)
    row = between(before, status(market))
    hosts.quality("there", 0.01)
    mended_at = time.monotonic()
    wait_for_all_agents(market)
    rows.append({"round_trip_ms": 20, "cut_s": cut_s, **row, "back_after_s": time.monotonic() - mended_at})
    print(rows[-1], file=sys.stderr)
    return rows


def table(rounds: list[list[Row]]) -> str:
    """Markdown: medians of the rounds, and the slowest and fastest."""
    lines = []
    for same in zip(*rounds, strict=True):
        loss = f"cut for {same[0]['cut_s']:g} s" if "cut_s" in same[0] else f"{same[0]['loss_percent']} %"
        back_s = median(same, "back_after_s")
        back = "" if back_s is None else f"; all agents back {back_s:.1f} s after the cable was mended"
        late = f"{100 * (median(same, 'fallback_share') or 0.0):.1f} %{back}"
        lines.append([f"{same[0]['round_trip_ms']} ms", loss, median_and_range(same, "slots_s", 1), late])
    return markdown(["round trip", "loss each way", "slots/s (min-max)", "actions that came too late"], lines)


def main() -> None:
    """Measure, print the table, write the figures."""
    options = parse_options(make_parser(), {"seconds": 1.0, "rounds": 1})
    reason = why_not()
    if reason is not None:
        raise SystemExit(f"network.py: {reason}")
    with tempfile.TemporaryDirectory() as name, NetworkHosts("there") as hosts:
        with contextlib.redirect_stdout(sys.stderr):
            certs = make_certs(Path(name) / "certs", "--host", hosts.here)
        market = RunningMarket("paper", ("--deadline", str(options.deadline), "--wait", "60"), certs=certs)
        market.endpoint = f"tls/{hosts.here}:{free_port()}"
        with market:
            for agent in AGENTS:
                role = ["grid"] if agent == "grid" else ["prosumer", "--id", agent]
                market.start(agent, *hosts.on("there", sys.executable, "-m", "zengrid_agent", *role))
            rounds = [one_round(hosts, market, options.seconds, options.cut) for _ in range(options.rounds)]
    print(table(rounds))
    write_results(options.out, deadline_s=options.deadline, rounds=rounds)


def make_parser() -> argparse.ArgumentParser:
    """Options of this script."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--seconds", type=float, default=10.0, help="for each cable (default: %(default)g)")
    parser.add_argument("--rounds", type=int, default=3, help="of all cables (default: %(default)s)")
    parser.add_argument("--deadline", type=float, default=2.0, help="of a phase [s] (default: %(default)g)")
    parser.add_argument("--cut", type=float, default=10.0, help="how long the cable is cut [s] (default: %(default)g)")
    return parser


if __name__ == "__main__":
    main()
