"""Reads CityLearn building files: hourly load and PV of measured homes, from the CityLearn Challenge 2022."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import ScenarioError
from zengrid.scenario.profiles import CalendarDay, Profiles, PvSeries
from zengrid.scenario.readers.csv_table import CsvTable

Floats = NDArray[np.float64]

SOURCE = (
    "The data is not part of zengrid. Get the CityLearn Challenge 2022 data set from its own source: repository "
    "intelligent-environments-lab/CityLearn, folder data/datasets/citylearn_challenge_2022_phase_all (MIT licence), "
    "and name the folder that holds its Building_*.csv"
)
_HOURS = 24
_HOLIDAY = 8
_DAY_TYPES = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun", "holiday")
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_MONTH_DAYS = (31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31)
# Headers of the challenge's first release.
_RENAME = {
    "Month": "month",
    "Hour": "hour",
    "Day Type": "day_type",
    "Equipment Electric Power [kWh]": "non_shiftable_load",
    "Solar Generation [W/kW]": "solar_generation",
}
_CALENDAR = ("month", "hour", "day_type")


def read_citylearn(folder: Path) -> Profiles:
    """Read every ``Building_*.csv`` of a folder; building 5 gives the load and the PV series ``building_5``.

    Loads are energies of an hour, so mean powers [kW]; PV is per rated power [W/kW]. Whole days begin with hour 1;
    hours before the first and after the last whole day are left out.

    Raises
    ------
    ScenarioError
        A file is invalid; the message names it, the line, the column and what is permitted.
    """
    files = {match[1]: path for path in folder.glob("*.csv") if (match := re.fullmatch(r"Building_(\w+)", path.stem))}
    if not files:
        raise ScenarioError(f"{folder}: holds no Building_*.csv. {SOURCE}.")
    load_kw: dict[str, Floats] = {}
    pv: dict[str, PvSeries] = {}
    first: CsvTable | None = None
    for number, path in sorted(files.items(), key=lambda item: (len(item[0]), item[0])):
        table = CsvTable(path, _RENAME)
        if first is None:
            first, (start, calendar) = table, _calendar(table)
        elif any(table.text(column) != first.text(column) for column in _CALENDAR):
            _calendar(table)  # Raises if the file itself is invalid; otherwise it covers another period.
            raise ScenarioError(
                f"{path}: its days are not those of {first.path.name}; needed: the same lines in all files"
            )
        part, name = slice(start, start + len(calendar) * _HOURS), f"building_{number}"
        load_kw[name] = table.numbers("non_shiftable_load")[part].reshape(-1, _HOURS)
        pv[name] = PvSeries(table.numbers("solar_generation")[part].reshape(-1, _HOURS) * 1e-3, 1.0)
    return Profiles(load_kw, pv, calendar)


def _calendar(table: CsvTable) -> tuple[int, tuple[CalendarDay, ...]]:
    """Row of the first whole day, and the dates of all whole days; raises if an hour is missing or repeated."""
    hours, months = table.numbers("hour", 1), table.numbers("month", 1)
    kinds = table.numbers("day_type", 1)
    for column, values, top in (("hour", hours, _HOURS), ("month", months, 12), ("day_type", kinds, _HOLIDAY)):
        wrong = (values > top) | (values % 1 != 0)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise table.error(row, column, f"{values[row]:g} is out of range; permitted: 1 to {top}")
    wrong = hours[1:] != hours[:-1] % _HOURS + 1
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        before, found = int(hours[row - 1]), int(hours[row])
        fault = "appears twice" if found == before else f"comes after hour {before}"
        raise table.error(row, "hour", f"hour {found} {fault}; permitted: hour {before % _HOURS + 1}")
    start = int(np.argmax(hours == 1))
    rows = range(start, len(hours) - _HOURS + 1, _HOURS)
    if hours[start] != 1 or not rows:
        raise ScenarioError(f"{table.path}: {len(hours)} hours hold no whole day; needed: hours 1 to 24 of one day")
    days = [(int(months[row]), int(kinds[row])) for row in rows]
    named = zip(days, _days_of_month([month for month, _ in days]), strict=True)
    return start, tuple(
        CalendarDay(month, day, f"{_DAY_TYPES[kind - 1]} {day} {_MONTHS[month - 1]}") for (month, kind), day in named
    )


def _days_of_month(months: list[int]) -> Iterator[int]:
    """Day of the month of each day: the first is counted back from the month's end, as files give only months."""
    until_end = next((i + 1 for i, (this, after) in enumerate(pairwise(months)) if this != after), 0)
    day = _MONTH_DAYS[months[0] - 1] - until_end + 1 if until_end else 1
    for position, month in enumerate(months):
        day = 1 if position and month != months[position - 1] else day
        yield day
        day += 1
