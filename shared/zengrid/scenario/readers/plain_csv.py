"""Reads plain CSV: a time stamp, and a PV and a load column for each home with the unit at the end of its name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import ScenarioError
from zengrid.scenario.profiles import DEFAULT_PV, CalendarDay, Profiles, PvSeries
from zengrid.scenario.readers import stamps
from zengrid.scenario.readers.csv_table import CsvTable

Floats = NDArray[np.float64]

_COLUMN = re.compile(r"(?:(?P<name>.+)_)?(?P<kind>pv|load)_(?P<unit>w_per_kw|kwh|wh|kw|w)")
_LOAD_UNITS = ("kw", "w", "kwh", "wh")
_PERMITTED = (
    "NAME_load_ or NAME_pv_ followed by kw, w, kwh or wh (PV also w_per_kw); pv_kw without NAME serves all homes"
)


def read_csv(
    path: Path, pv_rated_kw: float | Mapping[str, float] | None = None, timezone: str | None = None
) -> Profiles:
    """Read loads and PV, either of one typical day (``00:00``, ``00:15``, ...) or of measured days with dates.

    Parameters
    ----------
    path:
        The file. Columns: ``time``, ``NAME_load_kw``, ``NAME_pv_kw`` and the like.
    pv_rated_kw:
        Rated power of the PV systems that the file measures, one number or one a name; PV in W per kW needs none. [kW]
    timezone:
        IANA name, for time stamps with an offset from UTC and to recognise daylight saving.

    Returns
    -------
    Profiles
        At the file's own step.

    Raises
    ------
    ScenarioError
        The file is invalid; the message names the line, the column and what is permitted.
    """
    table = CsvTable(path)
    step = stamps.clock_times(table, "time")
    part = slice(None)
    calendar: tuple[CalendarDay, ...] = ()
    if step is None:
        minutes = stamps.dates(table, "time", timezone)
        step = stamps.even_step(table, "time", minutes, np.arange(len(minutes)), timezone)
        part, calendar = stamps.whole_days(path, minutes, step)

    load_kw: dict[str, Floats] = {}
    pv: dict[str, PvSeries] = {}
    for column in table.header:
        if column == "time":
            continue
        match = _COLUMN.fullmatch(column)
        if match is None or (match["kind"] == "load" and (match["name"] is None or match["unit"] not in _LOAD_UNITS)):
            raise ScenarioError(f'{path}, line 1: column "{column}" has no known unit; permitted: {_PERMITTED}')
        name, unit = match["name"] or DEFAULT_PV, match["unit"]
        # kWh and Wh are energies of one step; everything else is a mean power.
        factor = {"kw": 1.0, "w": 1e-3, "kwh": 60.0 / step, "wh": 0.06 / step, "w_per_kw": 1e-3}[unit]
        values = table.numbers(column)[part].reshape(-1, stamps.DAY // step)
        values = values if factor == 1.0 else values * factor
        if name in (load_kw if match["kind"] == "load" else pv):
            raise ScenarioError(f'{path}, line 1: column "{column}" is given in two units; permitted: once')
        if match["kind"] == "load":
            load_kw[name] = values
        else:
            pv[name] = PvSeries(values, 1.0 if unit == "w_per_kw" else _rated_kw(path, column, name, pv_rated_kw))
    if not load_kw:
        raise ScenarioError(f"{path}, line 1: no column holds a load; permitted: {_PERMITTED}")
    return Profiles(load_kw, pv, calendar)


def _rated_kw(path: Path, column: str, name: str, given: float | Mapping[str, float] | None) -> float:
    rated = given.get(name) if isinstance(given, Mapping) else given
    if rated is None:
        raise ScenarioError(
            f'{path}, line 1: column "{column}" is a power, but of how large a system? '
            f"needed: data.pv_rated_kw in the scenario (or PV in w_per_kw)"
        )
    return rated
