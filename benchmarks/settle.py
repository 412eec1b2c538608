"""Time to settle one slot: of a small market, of 1000 days side by side, and of a city.

    python benchmarks/settle.py

Claim: docs/measurements/performance.md, "What the parts of a slot cost". Takes 10 seconds; needs nothing.
"""

from __future__ import annotations

import statistics
import timeit

import numpy as np

from kit.script import parse_options, script_parser, write_results
from zengrid.core.params import Facilities, Homes, MarketParams
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous

FACILITIES = Facilities.of([20.0, 50.0], [0.03, 0.33], [0.0, 0.012], p_min_kw=[5.0, 0.0])
CASES = {"3 homes": ((), 3), "1000 days of 3 homes": ((1000,), 3), "10,000 homes": ((), 10_000)}
"""Leading axes and homes."""


def main() -> None:
    """Measure, print the figures, write them."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--rounds", type=int, default=9, help="repetitions (default: %(default)s)")
    options = parse_options(parser, {"rounds": 1})
    results = {label: time_a_slot(lead, homes, options.rounds) for label, (lead, homes) in CASES.items()}
    for label, seconds in results.items():
        print(f"{label}: {seconds * 1e6:.0f} us a slot")
    write_results(options.out, seconds_a_slot=results)


def time_a_slot(lead: tuple[int, ...], homes: int, rounds: int) -> float:
    """Median over the rounds. [s]"""
    rng = np.random.default_rng(0)
    market = MarketParams(Homes.of(rng.uniform(2.0, 20.0, homes)), FACILITIES, dt_h=1.0)
    soc, pv_kw, load_kw = (rng.uniform(0.2, 0.8, (*lead, homes)) for _ in range(3))
    exogenous = Exogenous(pv_kw, load_kw, np.full((*lead, 1), 15.0), np.full(lead, 0.095))
    action = Action(np.full(lead, 0.05), rng.uniform(-2.0, 2.0, (*lead, homes)))
    timer = timeit.Timer(lambda: settle(soc, action, exogenous, market))
    number, _ = timer.autorange()
    return statistics.median(timer.repeat(rounds, number)) / number


if __name__ == "__main__":
    main()
