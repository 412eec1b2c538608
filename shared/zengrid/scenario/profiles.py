"""Named profiles of whole days, and their resampling to the slots of a market."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DEFAULT_PV = ""
"""Name of the PV series for every home without its own."""


class CalendarDay(NamedTuple):
    """The date of a measured day, without its year."""

    month: int
    day: int
    label: str


class PvSeries(NamedTuple):
    """Output of one PV system.

    power_kw: ``(day, step)`` mean power. [kW]
    rated_kw: its rated power, to scale the series to other systems. [kW]
    """

    power_kw: Floats
    rated_kw: float


@dataclass(frozen=True, slots=True)
class Profiles:
    """Content of a data source: loads in kW ``(day, step)``, PV, and the dates of the days if they have any.

    A single day is a typical day, which a scenario repeats (with its noise). Several days are measured days.
    """

    load_kw: Mapping[str, Floats]
    pv: Mapping[str, PvSeries] = field(default_factory=dict)
    calendar: tuple[CalendarDay, ...] = ()

    @property
    def count(self) -> int:
        """Number of different days."""
        first = next(iter(self.load_kw.values()), None)
        if first is None:
            first = next(series.power_kw for series in self.pv.values())
        return int(first.shape[0])

    def resampled(self, slots: int) -> Profiles:
        """The same days as means over ``slots`` equal parts of a day."""
        load_kw = {name: resample(values, slots) for name, values in self.load_kw.items()}
        pv = {name: PvSeries(resample(power, slots), rated) for name, (power, rated) in self.pv.items()}
        return Profiles(load_kw, pv, self.calendar)


def resample(power: Floats, slots: int) -> Floats:
    """Mean power over ``slots`` equal parts of a day, from means over any other number of equal parts.

    Energy is conserved: power is taken as constant within each given part.

    Parameters
    ----------
    power:
        Mean power, not negative, ``(..., part)``. [kW]
    slots:
        Number of parts of the result.

    Returns
    -------
    ``(..., slots)``. [kW]
    """
    given = power.shape[-1]
    if given == slots:
        return np.ascontiguousarray(power)
    if given % slots == 0:
        return np.ascontiguousarray(power.reshape(*power.shape[:-1], slots, given // slots).mean(axis=-1))
    if slots % given == 0:
        return np.ascontiguousarray(np.repeat(power, slots // given, axis=-1))
    # Neither number divides the other. Cumulated energy is piecewise linear, and its differences are the new means.
    energy = np.concatenate([np.zeros((*power.shape[:-1], 1)), np.cumsum(power, axis=-1)], axis=-1) / given
    edges = np.arange(slots + 1) * given
    before, rest = edges // slots, (edges % slots) / slots
    after = np.minimum(before + 1, given)
    at_edges = energy[..., before] * (1.0 - rest) + energy[..., after] * rest
    # Rounding may make differences of sums negative.
    return np.ascontiguousarray(np.maximum(np.diff(at_edges, axis=-1) * slots, 0.0))
