"""Time to commit a slot to the journal, by homes and durability.

    python benchmarks/journal.py

Claims: docs/measurements/journal.md, docs/measurements/performance.md.
Takes 2 minutes; needs disk space in the current folder,
whose disk is measured.
"""

from __future__ import annotations

import sqlite3
import tempfile
import time
from pathlib import Path
from typing import Literal

import numpy as np

from kit.script import parse_options, script_parser, write_results
from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous
from zengrid.journal import Journal, RosterRecord, SlotRecord

SLOTS_PER_DAY = 96
PATTERNS = 16
"""Different slots that are committed in turn."""


def settled_slot(homes: int, rng: np.random.Generator) -> SlotRecord:
    """A settled slot of a market of any size."""
    market = MarketParams(
        Homes.of(np.full(homes, 8.0)), Facilities.of([20.0, 50.0 + 10.0 * homes], [0.03, 0.3]), dt_h=24 / SLOTS_PER_DAY
    )
    day = Exogenous(
        pv_kw=rng.uniform(0.0, 4.0, homes),
        load_kw=rng.uniform(0.2, 3.0, homes),
        consumer_kw=rng.uniform(5.0, 20.0, 1),
        sell_price=np.asarray(0.095),
    )
    settled = settle(rng.uniform(0.1, 0.9, homes), Action(np.asarray(0.08), rng.uniform(-2.0, 2.0, homes)), day, market)
    return SlotRecord.of(0, 0, 0, 0.0, 0.08, day, settled, settled, np.zeros(homes, np.bool_), False, 1)


def time_commits(place: Path, homes: int, slots: int, durability: Literal["normal", "full"]) -> dict[str, float]:
    """Commit so many slots; figures of the time each took [us], and bytes on disk."""
    rng = np.random.default_rng(0)
    patterns = [settled_slot(homes, rng) for _ in range(PATTERNS)]
    names = tuple(f"h{i}" for i in range(homes))
    roster = RosterRecord(1, names, tuple({"id": name} for name in names), ())
    times = np.empty(slots)
    with Journal.open(place, durability=durability) as journal:
        run = journal.begin("benchmark", "", seed=0, dt_h=24 / SLOTS_PER_DAY, version="")
        for i in range(slots):
            record = patterns[i % PATTERNS]._replace(
                position=i,
                day=i // SLOTS_PER_DAY,
                slot=i % SLOTS_PER_DAY,
                settled_at=time.time(),
            )
            began = time.perf_counter()
            run.commit(record, roster if i == 0 else None)
            times[i] = time.perf_counter() - began
    later = times[1:] * 1e6
    return {
        "first_us": times[0] * 1e6,
        "median_us": float(np.median(later)),
        "p99_us": float(np.percentile(later, 99)),
        "max_us": float(later.max()),
        "mean_us": float(later.mean()),
        "bytes_per_slot": place.stat().st_size / slots,
    }


def main() -> None:
    """Measure, print a table, write the figures."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--homes", type=int, nargs="+", default=[3, 100, 10_000])
    parser.add_argument("--slots", type=int, default=20_000, help="for 3 homes; fewer for more (default: %(default)s)")
    options = parse_options(parser, {"homes": [3], "slots": 1000})
    results = []
    print(f"{'homes':>6} {'durability':>10} {'slots':>6} {'median':>9} {'p99':>9} {'max':>10} {'mean':>9}  us a commit")
    for homes in options.homes:
        for durability in ("normal", "full"):
            slots = max(200, min(options.slots, options.slots * 50 // homes) // (5 if durability == "full" else 1))
            with tempfile.TemporaryDirectory(dir=".") as folder:
                result = time_commits(Path(folder) / "journal.db", homes, slots, durability)
            results.append({"homes": homes, "durability": durability, "slots": slots, **result})
            print(
                f"{homes:6} {durability:>10} {slots:6} {result['median_us']:9.0f} {result['p99_us']:9.0f} "
                f"{result['max_us']:10.0f} {result['mean_us']:9.0f}",
                flush=True,
            )
    write_results(options.out, sqlite=sqlite3.sqlite_version, results=results)


if __name__ == "__main__":
    main()
