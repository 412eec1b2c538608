"""Days of a scenario: PV, loads and prices, which depend only on the scenario, its seed and the day's number."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zengrid.core.state import Exogenous
from zengrid.errors import ScenarioError
from zengrid.scenario.home_spec import HomeSpec
from zengrid.scenario.noise import load_factor, sun_share
from zengrid.scenario.profiles import DEFAULT_PV, Profiles, resample
from zengrid.scenario.randomness import RandomKeys, keys_of
from zengrid.scenario.scenario import Scenario
from zengrid.scenario.site import clear_sky, pv_output
from zengrid.scenario.source import CsvData, read_profiles

Floats = NDArray[np.float64]
DayNumbers = NDArray[np.int64]

_KEPT_DAYS = 8
_KEPT_HOMES = 64
# Days are generated in portions of about this many values, to bound memory.
_PORTION = 1_000_000


class _Column(NamedTuple):
    """Profiles of a set of homes: the series and the factor of each home."""

    series: Floats  # (day, slot, series) [kW]
    choice: NDArray[np.intp]  # (home,)
    factor: Floats  # (home,)

    def of(self, days: DayNumbers) -> Floats:
        """``(day, slot, home)``. [kW]"""
        values = np.take(self.series[days], self.choice, axis=2)
        values *= self.factor
        return values


class _Members(NamedTuple):
    pv: _Column
    load: _Column
    keys: RandomKeys


class Days:
    """Generates the days of a scenario by their number, from 0. It reads the data once, so keep the object.

    A typical day can be played without end: the first ``split.evaluation_days`` days are for evaluation (a live market
    plays them first), and training days follow. Measured days are numbered in the order of the data and repeat after
    its end; their dates determine which are for evaluation.

    Raises
    ------
    ScenarioError
        The data cannot be read, or lacks a profile that the scenario names.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._slots = scenario.slots_per_day
        data = scenario.data
        if isinstance(data, CsvData) and data.timezone is None and scenario.site is not None:
            data = data.model_copy(update={"timezone": scenario.site.timezone})
        self._profiles: Profiles = read_profiles(data, scenario.slot_minutes)
        self._homes = self._members(scenario.homes)
        consumers = scenario.consumers
        loads = np.zeros((self._profiles.count, self._slots, len(consumers)))
        for place, consumer in enumerate(consumers):
            for name in consumer.profiles:
                loads[..., place] += self._load(name, f"consumers.{place}.profiles")
            loads[..., place] *= consumer.scale
        self._consumers = loads
        self._consumer_keys = self._keys("consumer", [consumer.name for consumer in consumers])
        self._consumer_noise = np.array([consumer.noise_share for consumer in consumers], dtype=np.float64)
        self._sky_key = self._keys("sky", ["sky"])
        self._sell_price = np.array(scenario.sell_prices)
        self._kept: OrderedDict[int, Exogenous] = OrderedDict()
        self._kept_homes: OrderedDict[tuple[HomeSpec, ...], _Members] = OrderedDict()

    @property
    def count(self) -> int | None:
        """Number of measured days; None if one typical day is repeated without end."""
        return len(self._profiles.calendar) if self._measured else None

    @property
    def _measured(self) -> bool:
        return len(self._profiles.calendar) > 1

    @cached_property
    def _default_profile(self) -> str:
        return self.scenario.homes[0].load.profile or next(iter(self._profiles.load_kw))

    @cached_property
    def _clear_sky(self) -> Floats:
        assert self.scenario.site is not None  # ``_pv_source`` has checked it
        dates = [(day.month, day.day) for day in self._profiles.calendar]
        return clear_sky(self.scenario.site, dates or None)

    def day(self, number: int) -> Exogenous:
        """Generate one day: read-only arrays ``(slot, home)``, ``(slot, consumer)`` and ``(slot,)``."""
        if number not in self._kept:
            made = self.days([number])
            day = made.part(0)
            for array in day:
                array.flags.writeable = False
            self._kept[number] = day
            if len(self._kept) > _KEPT_DAYS:
                self._kept.popitem(last=False)
        return self._kept[number]

    def days(self, numbers: ArrayLike) -> Exogenous:
        """Generate many days at once: bit for bit the same as ``day``, with a leading axis ``(day, ...)``."""
        wanted = self._numbers(numbers)
        sun = sun_share(self.scenario.noise, self._sky_key, wanted, self._slots)
        pv_kw, load_kw = self._generate(self._homes, wanted, sun)
        consumer_kw = self._consumers[wanted % self._profiles.count]
        factor = load_factor(self.scenario.noise, self._consumer_keys, wanted, self._slots, self._consumer_noise)
        if factor is not None:
            consumer_kw *= factor
        return Exogenous(pv_kw, load_kw, consumer_kw, np.tile(self._sell_price, (len(wanted), 1)))

    def check(self, homes: Sequence[HomeSpec]) -> None:
        """Raise ScenarioError if the data has no profile for one of these homes; fast even for many homes."""
        default = self._default_profile
        for home in homes:
            profile = home.load.profile or default
            self._load(profile, f"home {home.id}: load.profile")
            self._pv_source(home, profile)

    def homes_day(self, homes: Sequence[HomeSpec], number: int) -> tuple[Floats, Floats]:
        """PV and load of any homes, each ``(slot, home)``. [kW]

        A home of the scenario has the same values as in ``day``, and so has one that joins later under its id.
        """
        key = tuple(homes)
        if key not in self._kept_homes:
            self._kept_homes[key] = self._members(homes)
            if len(self._kept_homes) > _KEPT_HOMES:
                self._kept_homes.popitem(last=False)
        wanted = self._numbers([number])
        sun = sun_share(self.scenario.noise, self._sky_key, wanted, self._slots)
        pv_kw, load_kw = self._generate(self._kept_homes[key], wanted, sun)
        return pv_kw[0], load_kw[0]

    def home_day(self, home: HomeSpec, number: int) -> tuple[Floats, Floats]:
        """PV and load of any home, each ``(slot,)``. [kW]"""
        pv_kw, load_kw = self.homes_day([home], number)
        return pv_kw[:, 0], load_kw[:, 0]

    def training(self, count: int) -> DayNumbers:
        """Numbers of ``count`` days for training, increasing."""
        if self._measured:
            return self._spread(count, evaluation=False)
        return np.arange(count, dtype=np.int64) + self.scenario.split.evaluation_days

    def evaluation(self, count: int) -> DayNumbers:
        """Numbers of ``count`` days that training never sees, increasing."""
        if self._measured:
            return self._spread(count, evaluation=True)
        limit = self.scenario.split.evaluation_days
        if count > limit:
            raise ScenarioError(f"{count} days for evaluation; permitted: 1 to {limit} (split.evaluation_days)")
        return np.arange(count, dtype=np.int64)

    def label(self, number: int) -> str:
        """Name of the day for people."""
        if not self._measured:
            return f"day {number}"
        lap, place = divmod(number, self._profiles.count)
        label = self._profiles.calendar[place].label
        return label if lap == 0 else f"{label}, round {lap + 1}"

    def date(self, number: int) -> tuple[int, int] | None:
        """Month and day of a measured day; None for a typical day."""
        if not self._measured:
            return None
        day = self._profiles.calendar[number % self._profiles.count]
        return day.month, day.day

    def _spread(self, count: int, *, evaluation: bool) -> DayNumbers:
        """Choose days evenly from the measured days of one kind; if there are too few, repeat them."""
        split, calendar = self.scenario.split, self._profiles.calendar
        if split.evaluation_months is not None:
            held_out = np.array([day.month in split.evaluation_months for day in calendar])
        else:
            held_out = np.arange(len(calendar)) % split.evaluation_every == split.evaluation_every - 1
        there = np.flatnonzero(held_out == evaluation)
        if not len(there):
            months = sorted({day.month for day in calendar})
            raise ScenarioError(
                f"split: no day is left for {'evaluation' if evaluation else 'training'}; the data has "
                f"{len(calendar)} days in months {', '.join(map(str, months))}"
            )
        if count <= len(there):
            return np.asarray(there[np.arange(count) * len(there) // max(count, 1)], dtype=np.int64)
        laps, places = np.divmod(np.arange(count), len(there))
        return np.asarray(laps * len(calendar) + there[places], dtype=np.int64)

    def _numbers(self, numbers: ArrayLike) -> DayNumbers:
        wanted = np.atleast_1d(np.asarray(numbers, dtype=np.int64))
        if wanted.ndim != 1 or (wanted < 0).any():
            raise ScenarioError(f"days = {numbers!r}; permitted: a list of numbers from 0")
        return wanted

    def _generate(self, members: _Members, wanted: DayNumbers, sun: Floats) -> tuple[Floats, Floats]:
        """PV and load, ``(day, slot, home)``, by elementwise operations only, so that batches do not change a bit."""
        shape = (len(wanted), self._slots, len(members.keys))
        portion = max(1, _PORTION // max(1, shape[1] * shape[2]))
        pv_kw, load_kw = np.empty(shape), np.empty(shape)
        for start in range(0, len(wanted), portion):
            part = slice(start, start + portion)
            days = wanted[part]
            np.multiply(members.pv.of(days % members.pv.series.shape[0]), sun[part, :, None], out=pv_kw[part])
            load = members.load.of(days % self._profiles.count)
            factor = load_factor(self.scenario.noise, members.keys, days, self._slots)
            load_kw[part] = load if factor is None else np.multiply(load, factor, out=factor)
        return pv_kw, load_kw

    def _keys(self, purpose: str, names: Sequence[str], seeds: Sequence[int] | int = 0) -> RandomKeys:
        branch = keys_of([purpose], self.scenario.seed)
        return keys_of(names, seeds) ^ branch

    def _load(self, name: str, field: str) -> Floats:
        if name not in self._profiles.load_kw:
            there = ", ".join(self._profiles.load_kw)
            raise ScenarioError(f'{field} = "{name}": the data has no such load; permitted: {there}')
        return self._profiles.load_kw[name]

    def _members(self, homes: Sequence[HomeSpec]) -> _Members:
        """The part of some homes that is the same on all days."""
        self.check(homes)
        profiles = [home.load.profile or self._default_profile for home in homes]
        names = {name: place for place, name in enumerate(dict.fromkeys(profiles))}
        load = _Column(
            np.stack([self._profiles.load_kw[name] for name in names], axis=-1),
            np.array([names[name] for name in profiles]),
            np.array([home.load.scale for home in homes]),
        )
        wanted = [self._pv_source(home, profile) for home, profile in zip(homes, profiles, strict=True)]
        sources = {source: place for place, source in enumerate(dict.fromkeys(wanted))}
        series = [self._pv_series(source) for source in sources]
        places = [sources[source] for source in wanted]
        pv = _Column(
            np.stack([power for power, _ in series], axis=-1),
            np.array(places),
            np.array([home.pv_kw / series[place][1] for home, place in zip(homes, places, strict=True)]),
        )
        keys = self._keys("home", [home.id for home in homes], [home.seed for home in homes])
        return _Members(pv, load, keys)

    def _pv_source(self, home: HomeSpec, profile: str) -> str | tuple[float, float] | None:
        """Source of a home's PV: name of a measured series, tilt and azimuth under the clear sky, or None."""
        if home.pv_kw == 0.0:
            return None
        site = self.scenario.site
        if home.tilt_deg is None and home.azimuth_deg is None:
            for name in (profile, DEFAULT_PV):
                if name in self._profiles.pv:
                    return name
        if site is None:
            raise ScenarioError(
                f"home {home.id}: pv_kw = {home.pv_kw:g}, but the data has no PV for it; "
                f"needed: site in the scenario, or a PV column for {profile} in the data"
            )
        tilt = site.tilt_deg if home.tilt_deg is None else home.tilt_deg
        return tilt, site.azimuth_deg if home.azimuth_deg is None else home.azimuth_deg

    def _pv_series(self, source: str | tuple[float, float] | None) -> tuple[Floats, float]:
        """Power ``(day, slot)`` and the rated power of the system. [kW]"""
        if isinstance(source, str):
            return self._profiles.pv[source]
        if source is None:
            return np.zeros((self._profiles.count, self._slots)), 1.0
        return resample(pv_output(self._clear_sky, *source), self._slots), 1.0
