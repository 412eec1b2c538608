"""Computes the data that ships with the built-in scenarios: ``python tools/make_scenario_data.py FOLDER``.

``village_15min.csv`` holds load shapes with a mean of 1 kW, chosen for zengrid: bumps around the hours at which such
households use most. ``sky_*.npy`` is the clear sky at the built-in scenarios' site, computed with pvlib. The profiles
of ``paper`` come from the case study and are not computed (see docs/scenarios.md).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.scenario import load
from zengrid.scenario.site import compute_clear_sky, sky_file

Floats = NDArray[np.float64]

STEPS = 96

SHAPES: dict[str, tuple[float, tuple[tuple[float, float, float], ...]]] = {
    "commuter": (0.45, ((7.0, 1.0, 1.0), (19.5, 2.0, 2.2))),
    "family": (0.40, ((7.5, 1.2, 1.0), (13.0, 2.5, 0.5), (18.5, 2.2, 1.9))),
    "homeoffice": (0.40, ((9.0, 1.5, 0.8), (13.0, 3.0, 1.2), (19.0, 2.0, 1.1))),
    "retired": (0.45, ((9.5, 2.0, 1.0), (12.5, 1.5, 0.8), (17.5, 2.5, 0.9))),
    "nightowl": (0.45, ((11.5, 1.5, 0.6), (21.0, 2.0, 1.6), (0.5, 1.5, 1.0))),
    "electriccar": (0.40, ((7.0, 1.0, 0.6), (18.5, 1.5, 1.3), (22.5, 1.8, 2.4))),
    "apartments": (0.80, ((8.0, 1.5, 0.15), (20.5, 1.8, 0.85))),
}
"""Base and bumps of each shape: hour of the peak, width [h], height relative to the base's unit."""


def load_shapes() -> dict[str, Floats]:
    """Every shape as means over 15 minutes, ``(slot,)``, of mean 1. [kW]"""
    hour = (np.arange(STEPS) + 0.5) * 24.0 / STEPS
    shapes = {}
    for name, (base, bumps) in SHAPES.items():
        values = np.full(STEPS, base)
        for peak, width, height in bumps:
            away = (hour - peak + 12.0) % 24.0 - 12.0
            values += height * np.exp(-0.5 * (away / width) ** 2)
        shapes[name] = values / values.mean()
    return shapes


def write_data(folder: Path) -> None:
    """Write all computed files into a folder."""
    shapes = load_shapes()
    lines = ["time," + ",".join(f"{name}_load_kw" for name in shapes)]
    for slot in range(STEPS):
        values = ",".join(f"{shape[slot]:.4f}" for shape in shapes.values())
        lines.append(f"{slot // 4:02d}:{slot % 4 * 15:02d},{values}")
    (folder / "village_15min.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    site = load("paper").site
    assert site is not None
    day = (int(site.date[:2]), int(site.date[3:]))
    np.save(folder / sky_file(site, None), compute_clear_sky(site, [day], standard_time=False))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    write_data(parser.parse_args().folder)
