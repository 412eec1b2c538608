"""Cost of a slot from 10 to 10,000 homes in a few fleets, with the journal on.

    python benchmarks/scale.py --rounds 2 --seconds 2

Claim: docs/measurements/scaling.md. Takes 5 minutes; needs nothing.

Markets run as users run them, ``zengrid up`` at full speed without a page: villages of any size in two fleets, and the
scenarios ``village`` and ``city``. Wall time depends on what else the machine does, CPU time of all processes hardly.
"""

from __future__ import annotations

import sys
import tempfile
from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np
import yaml

from kit.market import measure_up
from kit.rounds import Row, alternate, markdown, median, median_and_range, shown, values
from kit.script import parse_options, script_parser, write_results

WARM_SLOTS = 48
"""Two days before measuring starts: profiles, the journal's first pages, and Python's caches."""
LARGE_HOMES = 100
"""The linear part is fitted from here on: below, the fixed cost of a slot's messages hides it."""


def scenario_file(homes: int, folder: Path) -> str:
    """A village of another size; consumer and facilities grow with it."""
    source = files("zengrid.scenario") / "builtin" / "village.yaml"
    body = yaml.safe_load(source.read_text(encoding="utf-8"))
    factor = homes / body["population"]["count"]
    body["population"]["count"] = homes
    body["fleets"] = 2
    for facility in body["facilities"]:
        for field, power in (("min_kw", 1), ("max_kw", 1), ("a", -1)):
            if field in facility:
                facility[field] *= factor**power
    body["consumers"][0]["scale"] *= factor
    body["name"] = f"village{homes}"
    path = folder / f"village{homes}.yaml"
    path.write_text(yaml.safe_dump(body))
    return str(path)


def measure(name: str, seconds: float) -> Row:
    """One run of a village with so many homes, or of a scenario."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = scenario_file(int(name), Path(folder)) if name.isdecimal() else name
        row, _ = measure_up(scenario, seconds, warm_slots=WARM_SLOTS)
    if row["fallbacks"]:
        print(f"{name}: {row['fallbacks']:.0f} fallbacks: deadlines were missed on this machine", file=sys.stderr)
    return row


def table(results: dict[str, list[Row]]) -> str:
    """Markdown, medians of the rounds."""
    lines = []
    for name, rows in results.items():
        cpu_ms, stored = median(rows, "cpu_ms") or 0.0, median(rows, "journal_bytes_per_slot") or 0.0
        each_us, memory_mb = 1e3 * cpu_ms / homes_of(name), shown(median(rows, "memory_mb"))
        speed = median_and_range(rows, "slots_s")
        lines.append([name, speed, f"{cpu_ms:.2f}", f"{each_us:.2f}", memory_mb, f"{stored / 1e3:.1f}"])
    columns = ["homes", "slots/s (min-max)", "CPU a slot [ms]", "CPU a home [µs]", "memory [MiB]"]
    return markdown([*columns, "journal a slot [kB]"], lines)


def homes_of(name: str) -> int:
    """Homes of a row."""
    return {"village": 100, "city": 10_000}.get(name) or int(name)


def fit(results: dict[str, list[Row]]) -> dict[str, float]:
    """CPU time of a slot as a fixed part and one that grows with the homes: least squares of relative deviations."""
    sizes = [name for name in results if name.isdecimal() and int(name) >= LARGE_HOMES]
    if len(sizes) < 3:
        return {}
    homes = np.array([int(name) for name in sizes], dtype=np.float64)
    cpu_ms = np.array([np.median(values(results[name], "cpu_ms")) for name in sizes])
    (fixed, each), *_ = np.linalg.lstsq(np.stack([1 / cpu_ms, homes / cpu_ms], axis=1), np.ones(len(sizes)), rcond=None)
    deviation = np.abs((fixed + each * homes) / cpu_ms - 1).max()
    return {"fixed_ms": float(fixed), "per_home_us": float(1e3 * each), "largest_deviation": float(deviation)}


def main() -> None:
    """Measure, print the table, write the figures."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--homes", type=int, nargs="+", default=[10, 30, 100, 300, 1000, 3000, 10_000])
    parser.add_argument("--scenarios", nargs="*", default=["village", "city"])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=3.0, help="of each run (default: %(default)g)")
    options = parse_options(parser, {"homes": [10, 100], "scenarios": [], "rounds": 1, "seconds": 0.5})
    names = [*map(str, options.homes), *options.scenarios]
    systems = {name: partial(measure, name, options.seconds) for name in names}
    results = alternate(systems, options.rounds, ("slots_s", "slots/s"))
    line = fit(results)
    print(table(results))
    if line:
        print(
            f"CPU a slot = {line['fixed_ms']:.2f} ms + {line['per_home_us']:.2f} µs a home, "
            f"to {100 * line['largest_deviation']:.0f} % from {LARGE_HOMES} homes on"
        )
    write_results(options.out, results=results, fit=line)


if __name__ == "__main__":
    main()
