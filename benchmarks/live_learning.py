"""What agents that start from nothing learn in a live market: figures beside the market without demand response.

    python benchmarks/live_learning.py --seeds 5 --minutes 4 --svg docs/img/learning-live.svg

Claim: docs/measurements/live-learning.md. Takes ``--seeds`` times ``--minutes``; needs torch.

Each seed is a market as users run it: ``zengrid up --learn`` at full speed, one process an agent, journal on. The curve
is read from the journal, over windows of four weeks; the last window counts as the result.
"""

from __future__ import annotations

import signal
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from kit.market import UpMarket
from kit.script import parse_options, script_parser, write_results
from zengrid.journal import Journal

WINDOW_DAYS = 28
UP = ("--learn", "--policy", "conventional", "--grid-policy", "fixed", "--speed", "max", "--no-http")


def run_market(seed: int, minutes: float, explore: int, folder: Path) -> dict[str, Any]:
    """Run one market for some minutes from its first slot on; its curve."""
    seeds = ("--seed", str(seed), "--learn-seed", str(seed), "--explore", str(explore))
    with UpMarket("paper", folder, *UP, *seeds) as market:
        with market.client() as client:
            market.wait_for_slots(client, 1)  # loading torch does not count
        try:
            market.up.wait(60.0 * minutes)
        except psutil.TimeoutExpired:
            market.up.send_signal(signal.SIGTERM)
        else:
            raise SystemExit(f"seed {seed}: the market ended before its time:\n{market.printed()}")
        market.wait_for_end(120.0)
    return {"seed": seed, **read(market.journal)}


def read(journal: Path) -> dict[str, Any]:
    """The curve of a journal: changes against the baseline in percent, window after window."""
    with Journal.open(journal, read_only=True) as opened:
        view = opened.run()
        columns: dict[str, list[Any]] = {}
        for block in view.blocks():
            for name, values in block.columns.items():
                columns.setdefault(name, []).append(values)
    whole = {name: np.concatenate(parts) for name, parts in columns.items()}
    size = WINDOW_DAYS * 24
    count = len(whole["position"]) // size

    def sums(values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.array(values[: count * size].reshape(count, size, *values.shape[1:]).sum(axis=1))

    def change(ours: np.ndarray[Any, Any], others: np.ndarray[Any, Any]) -> list[Any]:
        return list((100.0 * (sums(ours) - sums(others)) / np.abs(sums(others))).round(2).tolist())

    fallback = whole["fallback"].any(axis=1) | (whole["grid_fallback"] > 0)
    took_s = float(whole["settled_at"][-1] - whole["settled_at"][0])
    return {
        "slots": len(fallback),
        "slots_per_s": round(len(fallback) / took_s, 1),
        "slots_with_a_fallback": int(fallback.sum()),
        "minutes": (
            (whole["settled_at"][size - 1 : count * size : size] - whole["settled_at"][0]) / 60.0
        ).round(2).tolist(),
        "bills_percent": change(whole["bill"], whole["baseline_bill"]),
        "profit_percent": change(whole["profit"], whole["baseline_profit"]),
        "reserve_percent": change(
            whole["facility_kw"][:, 1:].sum(axis=1), whole["baseline_facility_kw"][:, 1:].sum(axis=1)
        ),
    }  # fmt: skip


def better_from(curve: dict[str, Any]) -> float | None:
    """Minutes after which all five figures stayed better than without demand response to the end."""
    bills = np.array(curve["bills_percent"])
    better = (bills < 0).all(axis=1) & (np.array(curve["profit_percent"]) > 0)
    better &= np.array(curve["reserve_percent"]) < 0
    if not better[-1]:
        return None
    worse = np.flatnonzero(~better)
    return float(curve["minutes"][0 if worse.size == 0 else worse[-1] + 1])


def draw(curves: list[dict[str, Any]], path: Path) -> None:
    """The curves as a figure."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "zengrid"
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    for curve in curves:
        bills = np.array(curve["bills_percent"])
        for place, axis_values in enumerate((bills, curve["profit_percent"], curve["reserve_percent"])):
            values = np.asarray(axis_values)
            for i, column in enumerate(values.T if values.ndim > 1 else [values]):
                label = f"p{i + 1}" if place == 0 and curve is curves[0] else None
                axes[place].plot(curve["minutes"], column, color=f"C{i}" if place == 0 else "C4", lw=1.2, label=label)
    for axis, title in zip(axes, ("bills", "grid profit", "reserve energy"), strict=True):
        axis.axhline(0.0, color="grey", lw=0.8)
        axis.set(title=title, xlabel="minutes", ylabel="against no demand response [%]")
        axis.grid(alpha=0.3)
    axes[0].legend()
    axes[0].set_ylim(-130, 60)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Run the markets one after the other; print how each ended, and write everything."""
    parser = script_parser(__doc__, __file__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=30.0, help="of each market (default: %(default)g)")
    parser.add_argument(
        "--explore", type=int, default=12_000, metavar="SLOTS", help="how long agents explore (default: %(default)s)"
    )
    parser.add_argument("--svg", type=Path, metavar="FILE", help="where to draw the curves")
    options = parse_options(parser, {"seeds": 1, "minutes": 0.5, "explore": 500})
    curves = []
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        with tempfile.TemporaryDirectory() as name:
            curves.append(run_market(seed, options.minutes, options.explore, Path(name)))
        print(f"seed {seed}: {describe(curves[-1])}", flush=True)
        write_results(options.out, explore=options.explore, window_days=WINDOW_DAYS, curves=curves)
    if options.svg:
        draw(curves, options.svg)


def describe(curve: dict[str, Any]) -> str:
    """How a market ended, in one line."""
    speed = f"{curve['slots']} slots, {curve['slots_per_s']} a second, {curve['slots_with_a_fallback']} with a fallback"
    if not curve["minutes"]:
        return f"{speed}; less than one window of {WINDOW_DAYS} days"
    bills = " ".join(f"{bill:+.0f}" for bill in curve["bills_percent"][-1])
    return (
        f"{speed}; at the end bills {bills} %, profit {curve['profit_percent'][-1]:+.0f} %, reserve "
        f"{curve['reserve_percent'][-1]:+.0f} %; all better from minute {better_from(curve)}"
    )


if __name__ == "__main__":
    main()
