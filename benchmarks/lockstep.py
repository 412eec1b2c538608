"""Slots a second of a whole market at full speed, beside HELICS, mosaik and bare Zenoh on the same market.

    python benchmarks/lockstep.py --peers
    python benchmarks/lockstep.py --homes 3 --rounds 15 --seconds 2 --certs
    python benchmarks/lockstep.py --homes 3 --rounds 20 --against ../other-checkout

Claims: docs/measurements/performance.md (slots a second, first slot), docs/measurements/network.md (certificates).
Takes about 10
minutes with all peers, 2 without. Needs nothing more for zengrid, and benchmarks/peers/requirements.txt for the peers.

A zengrid market runs as users run it, ``zengrid up`` with one process an agent and the journal on. Every round runs all
systems one after the other; ratios are taken within each round. All of them settle the same slots: a run whose profits
differ from zengrid's core is an error. ``--certs`` adds the market over TLS with certificates on both sides.
``--against`` adds another checkout, which measures itself with its own code and its own lockstep.py.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kit.market import measure_up, paper_with
from kit.rounds import Row, alternate, markdown, median, median_and_range, ratios, shown, values
from kit.script import ROOT, parse_options, script_parser, write_results

PEERS = ROOT / "benchmarks" / "peers"
sys.path.append(str(PEERS))
from agent_rules import GRID_POLICY, PROSUMER_POLICY  # noqa: E402
from same_market import reference  # noqa: E402

ZENGRID, SECURED = "zengrid", "zengrid, certificates"
PEER_SCRIPTS = {
    "bare Zenoh": ("zenoh_market.py",),
    "HELICS ipc": ("helics_market.py", "--core", "ipc"),
    "HELICS zmq": ("helics_market.py", "--core", "zmq"),
    "mosaik": ("mosaik_market.py",),
}
PEER_SLOTS = {3: 600, 10: 200, 30: 60}
"""Slots that count in a peer's run, by homes."""
ZENOH_SLOTS_FACTOR = 5
"""Bare Zenoh is faster, so it plays more of them."""
PEER_TIMEOUT_S = 120.0
"""A peer's run that takes longer has failed. [s]"""
CHECKED_SLOTS = 240
"""Slots of a zengrid run whose profits are compared with the core's."""


def main() -> None:
    """Measure, print the tables, write the figures."""
    options = parse_options(make_parser(), {"homes": [3], "rounds": 1, "seconds": 0.5})
    results: dict[int, dict[str, list[Row]]] = {}
    with tempfile.TemporaryDirectory(prefix="zengrid-lockstep-") as name:
        certs = make_certificates(Path(name) / "certs", max(options.homes)) if options.certs else None
        for homes in options.homes:
            systems = choose_systems(options, homes, certs)
            results[homes] = alternate(systems, options.rounds, ("slots_s", "slots/s"), f"{homes} homes")
    print(table(results))
    for homes, rows in results.items():
        if options.certs:
            print(comparison(f"{homes} homes, certificates:", rows[SECURED], rows[ZENGRID]))
        if options.against:
            print(comparison(f"{homes} homes, against {options.against}:", rows[ZENGRID], rows[str(options.against)]))
    write_results(options.out, rounds=options.rounds, results=results)


def make_parser() -> argparse.ArgumentParser:
    """Options of this script."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--homes", type=int, nargs="+", default=[3, 10, 30])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each run of zengrid (default: %(default)g)")
    parser.add_argument(
        "--peers",
        nargs="*",
        choices=list(PEER_SCRIPTS),
        metavar="PEER",
        help=f"systems to compare with (default where given without names: all of {', '.join(PEER_SCRIPTS)})",
    )
    parser.add_argument("--certs", action="store_true", help="measure zengrid with certificates, too")
    parser.add_argument("--against", type=Path, metavar="PATH", help="another checkout of zengrid to compare with")
    return parser


def choose_systems(options: argparse.Namespace, homes: int, certs: Path | None) -> dict[str, Callable[[], Row]]:
    """What is measured, by name."""
    systems: dict[str, Callable[[], Row]] = {ZENGRID: partial(measure_zengrid, homes, options.seconds)}
    if options.against is not None:
        # Both measure themselves in processes of their own, so that nothing but the code differs.
        systems[ZENGRID] = partial(measure_checkout, ROOT, homes, options.seconds)
        systems[str(options.against)] = partial(measure_checkout, options.against.resolve(), homes, options.seconds)
    if certs is not None:
        systems[SECURED] = partial(measure_zengrid, homes, options.seconds, certs)
    names = list(PEER_SCRIPTS) if options.peers == [] else options.peers or []
    return systems | {name: partial(measure_peer, name, homes) for name in names}


def measure_zengrid(homes: int, seconds: float, certs: Path | None = None) -> Row:
    """One run of ``zengrid up``, over TLS where there are certificates."""
    with tempfile.TemporaryDirectory() as name:
        scenario = paper_with(homes, Path(name))
        # What decides is not measured here: rules, as the peers have.
        policies = ("--policy", PROSUMER_POLICY, "--grid-policy", GRID_POLICY)
        row, profits = measure_up(scenario, seconds, *policies, certs=certs)
    if row["fallbacks"]:
        raise SystemExit(f"{row['fallbacks']:.0f} fallbacks at {homes} homes: this run measures deadlines, not speed")
    count = min(CHECKED_SLOTS, len(profits))
    if profits[:count] != reference(homes, count)[0]:
        raise SystemExit(f"{homes} homes: zengrid up settled other profits than zengrid's core in a loop")
    return row


def measure_checkout(checkout: Path, homes: int, seconds: float) -> Row:
    """One run of a checkout, measured by its own lockstep.py with its own code."""
    environment = {**os.environ, "PYTHONPATH": f"{checkout / 'shared'}:{checkout / 'services'}"}
    origin = "import zengrid, zengrid_cli; print(zengrid.__file__, zengrid_cli.__file__, sep='\\n')"
    found = subprocess.run([sys.executable, "-c", origin], env=environment, capture_output=True, text=True, check=True)
    if not all(Path(file).resolve().is_relative_to(checkout) for file in found.stdout.split()):
        raise SystemExit(f"{checkout}: Python imports zengrid from {found.stdout.split()[0]} instead")
    with tempfile.TemporaryDirectory() as name:
        out = Path(name) / "lockstep.json"
        command = [sys.executable, "benchmarks/lockstep.py", "--homes", str(homes), "--rounds", "1"]
        command += ["--seconds", str(seconds), "--out", str(out)]
        done = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{checkout}: lockstep.py ended with exit code {done.returncode}:\n{done.stderr[-2000:]}")
        (row,) = json.loads(out.read_text())["results"][str(homes)][ZENGRID]
    return {str(key): float(value) for key, value in row.items()}


def measure_peer(name: str, homes: int) -> Row:
    """One run of a peer, which checks its own settlement; no figures where it failed."""
    script, *words = PEER_SCRIPTS[name]
    slots = PEER_SLOTS.get(homes, 60) * (ZENOH_SLOTS_FACTOR if name == "bare Zenoh" else 1)
    command = [sys.executable, str(PEERS / script), *words, "--homes", str(homes)]
    command += ["--slots", str(slots), "--warm-up", str(max(10, slots // 10)), "--timeout", str(PEER_TIMEOUT_S)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        print(f"{name}, {homes} homes, failed: {done.stderr[-1000:]}", file=sys.stderr)
        return {}
    row = json.loads(done.stdout.splitlines()[-1])
    return {key: float(value) for key, value in row.items() if key not in ("system", "homes", "settlement")}


def make_certificates(folder: Path, homes: int) -> Path:
    """Certificates for a market of so many homes."""
    ids = ",".join(f"p{i + 1}" for i in range(homes))
    command = [sys.executable, "-m", "zengrid_cli", "certs", str(folder), "--ids", ids]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def table(results: dict[int, dict[str, list[Row]]]) -> str:
    """Markdown."""
    columns = ["homes", "system", "slots/s (min-max)", "zengrid / it", "price p50 / p99 [ms]", "battery p50 / p99 [ms]"]
    lines = []
    for homes, by_name in results.items():
        for name, rows in by_name.items():
            within = ratios(by_name[ZENGRID], rows, "slots_s")
            phases = [
                f"{shown(median(rows, f'{phase}_p50_ms'), 2)} / {shown(median(rows, f'{phase}_p99_ms'), 2)}"
                for phase in ("price", "battery")
            ]
            ratio = f"{statistics.median(within):.2f}" if within and name != ZENGRID else ""
            first = shown(median(rows, "first_slot_s"), 2)
            lines.append([str(homes), name, median_and_range(rows, "slots_s"), ratio, *phases, first])
    return markdown([*columns, "first slot [s]"], lines)


def comparison(label: str, rows: list[Row], others: list[Row]) -> str:
    """Each figure of two systems: both medians, their ratio, and the ratios within rounds with their spread."""
    units = {"slots_s": "slots/s", "cpu_ms": "ms CPU/slot", "price_p50_ms": "ms price", "battery_p50_ms": "ms battery"}
    lines = []
    for key, unit in units.items():
        of_medians = statistics.median(values(rows, key)) / statistics.median(values(others, key))
        low, middle, high = quartiles(ratios(rows, others, key))
        within = f"{percent(middle)} ({percent(low)} to {percent(high)})"
        both = (median_and_range(others, key, 2), median_and_range(rows, key, 2))
        lines.append([unit, *both, percent(of_medians), within])
    columns = ["", "without", "with", "medians differ by", "within rounds, median (quartiles)"]
    return f"\n{label}\n\n{markdown(columns, lines)}"


def quartiles(numbers: list[float]) -> list[float]:
    """The three quartiles."""
    return statistics.quantiles(numbers, n=4, method="inclusive") if len(numbers) > 1 else numbers * 3


def percent(ratio: float) -> str:
    """A ratio as a change."""
    return f"{100.0 * (ratio - 1.0):+.1f} %"


if __name__ == "__main__":
    main()
