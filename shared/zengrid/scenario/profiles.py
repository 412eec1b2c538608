"""Named profiles of whole days, as read from data, and their resampling to the slots of a market."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DEFAULT_PV = ""
"""Name of the PV series that serves every home without one of its own."""


class CalendarDay(NamedTuple):
    """The date of a measured day, without its year."""

    month: int
    day: int
    label: str


class PvSeries(NamedTuple):
    """Output of one PV system.

    power_kw: ``(day, step)`` mean power. [kW]
    rated_kw: its rated power, by which it is scaled to other systems. [kW]
    """

    power_kw: Floats
    rated_kw: float


@dataclass(frozen=True, slots=True)
class Profiles:
    """What a data source holds: loads in kW ``(day, step)``, PV, and the days' dates where they have any.

    One day is a typical day, which a scenario repeats (with noise, if it has any); more are measured days.
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

    Energy is conserved: power counts as constant within each given part.

    Parameters
    ----------
    power:
        Mean power, not negative, ``(..., part)``. [kW]
    slots:
        Number of parts wanted.

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
    # Neither divides the other: energy up to each moment is piecewise linear, so its differences are the new means.
    energy = np.concatenate([np.zeros((*power.shape[:-1], 1)), np.cumsum(power, axis=-1)], axis=-1) / given
    edges = np.arange(slots + 1) * given
    before, rest = edges // slots, (edges % slots) / slots
    after = np.minimum(before + 1, given)
    at_edges = energy[..., before] * (1.0 - rest) + energy[..., after] * rest
    # Differences of sums may fall below 0 by rounding.
    return np.ascontiguousarray(np.maximum(np.diff(at_edges, axis=-1) * slots, 0.0))
