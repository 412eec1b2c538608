"""Profiles of the coming days, generated many days at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zengrid.core.state import Exogenous

if TYPE_CHECKING:
    from zengrid.scenario import Days

DAYS_AHEAD = 32
VALUES_AHEAD = 100_000
"""Days generated at a time: at most so many, and at most so many values of one column."""


class ProfilesAhead:
    """Generates days of the scenario together: one day alone costs as much as all of them.

    Parameters
    ----------
    values_per_day:
        Values of one column in a day: slots times homes.
    """

    def __init__(self, days: Days, values_per_day: int) -> None:
        self._days = days
        self._count = max(1, min(DAYS_AHEAD, VALUES_AHEAD // values_per_day))
        self._profiles = Exogenous(*np.zeros((4, 0)))
        self._first = 0
        """The first day of the profiles."""

    def day(self, day: int) -> Exogenous:
        """Profiles of one day, ``(slot, ...)``."""
        if not 0 <= day - self._first < len(self._profiles.pv_kw):
            self._profiles = self._days.days(np.arange(day, day + self._count))
            self._first = day
        return self._profiles.part(day - self._first)

    def from_day(self, day: int) -> Exogenous:
        """Profiles from a day on that ``day`` has returned, as far as they are there, ``(day, slot, ...)``."""
        return self._profiles.part(slice(day - self._first, None))
