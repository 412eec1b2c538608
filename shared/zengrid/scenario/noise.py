"""Noise between days: clouds over the whole market, and each home's own variation of load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from zengrid.scenario.home_spec import Spec
from zengrid.scenario.randomness import RandomKeys, bell, fork, uniform

Floats = NDArray[np.float64]
DayNumbers = NDArray[np.int64]

_HOURS = 24
_DARKEST = 0.9


class Noise(Spec):
    """How days differ from their profile, and homes from each other. All 0 plays the profiles as they are."""

    cloudiness: float = Field(
        default=0.0, ge=0.0, le=1.0, description="Share of the sun's energy that clouds absorb [-]."
    )
    load_level: float = Field(default=0.0, ge=0.0, le=1.0, description="Standard deviation of a home's day [-].")
    load_noise: float = Field(default=0.0, ge=0.0, le=1.0, description="Standard deviation of a home's slot [-].")


def sun_share(noise: Noise, key: RandomKeys, days: DayNumbers, slots: int) -> Floats:
    """Share of the clear sky's energy that clouds let through, ``(day, slot)``. [-]

    A day's cover is uniform between 0 and twice ``cloudiness``. Clouds change from hour to hour: at each full hour the
    cover is multiplied by a number between 0 and 2, linear in between. It takes at most 90 %.

    Parameters
    ----------
    noise:
        Its ``cloudiness``.
    key:
        Key of the place, ``(1,)``: all homes have the same sky.
    days:
        Day numbers, ``(day,)``.
    slots:
        Slots a day.
    """
    if noise.cloudiness == 0.0:
        return np.ones((len(days), slots))
    of_day = fork(key, days)
    cover = uniform(fork(of_day, 0)) * (2.0 * noise.cloudiness)
    passing = uniform(fork(fork(of_day, 1)[:, None], np.arange(_HOURS + 1))) * 2.0
    # A slot takes the value at its middle.
    hour = (np.arange(slots) + 0.5) * (_HOURS / slots)
    before = hour.astype(np.int64)
    rest = hour - before
    taken = cover[:, None] * (passing[:, before] * (1.0 - rest) + passing[:, before + 1] * rest)
    return np.asarray(1.0 - np.minimum(taken, _DARKEST))


def load_factor(
    noise: Noise, keys: RandomKeys, days: DayNumbers, slots: int, share: Floats | float = 1.0
) -> Floats | None:
    """Factor on the load of each home, ``(day, slot, home)``, at least 0; None if there is no noise. [-]

    It is the product of a number for the day and one for the slot, both bell-shaped around 1.

    Parameters
    ----------
    noise:
        Its ``load_level`` and ``load_noise``.
    keys:
        Keys of the homes, ``(home,)``: each home is independent of the others.
    days:
        Day numbers, ``(day,)``.
    slots:
        Slots a day.
    share:
        Share of the noise that applies, ``(home,)`` or one number: many customers together vary less than one. [-]
    """
    if noise.load_level == 0.0 and noise.load_noise == 0.0:
        return None
    of_day = fork(keys, days[:, None])
    level = 1.0 + bell(fork(of_day, 0)) * (noise.load_level * share)
    if noise.load_noise == 0.0:
        return np.repeat(np.maximum(level, 0.0)[:, None, :], slots, axis=1)
    factor = bell(fork(fork(of_day, 1)[:, None, :], np.arange(slots)[:, None]))
    factor *= noise.load_noise * share
    factor += 1.0
    factor *= level[:, None, :]
    return np.maximum(factor, 0.0, out=factor)
