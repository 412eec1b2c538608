"""What settling one slot costs, for a small market, for many days side by side, and for a city.

python benchmarks/settle.py
"""

from __future__ import annotations

import statistics
import timeit

import numpy as np

from zengrid.core.params import Facilities, Homes, Market
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous

FACILITIES = Facilities.of([20.0, 50.0], [0.03, 0.33], [0.0, 0.012], p_min_kw=[5.0, 0.0])


def seconds_a_slot(lead: tuple[int, ...], homes: int) -> float:
    """Median over nine repetitions. [s]"""
    rng = np.random.default_rng(0)
    market = Market(Homes.of(rng.uniform(2.0, 20.0, homes)), FACILITIES, dt_h=1.0)
    soc, pv_kw, load_kw = (rng.uniform(0.2, 0.8, (*lead, homes)) for _ in range(3))
    exogenous = Exogenous(pv_kw, load_kw, np.full((*lead, 1), 15.0), np.full(lead, 0.095))
    action = Action(np.full(lead, 0.05), rng.uniform(-2.0, 2.0, (*lead, homes)))
    timer = timeit.Timer(lambda: settle(soc, action, exogenous, market))
    number, _ = timer.autorange()
    return statistics.median(timer.repeat(9, number)) / number


def main() -> None:
    """Print the three figures."""
    for label, lead, homes in (("3 homes", (), 3), ("1000 days of 3 homes", (1000,), 3), ("10,000 homes", (), 10_000)):
        print(f"{label}: {seconds_a_slot(lead, homes) * 1e6:.0f} us a slot")


if __name__ == "__main__":
    main()
