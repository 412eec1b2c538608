"""Reads CAISO OASIS exports: the shapes of California's demand and solar output, scaled to homes.

Two reports are used: the system load SLD_FCST and, for PV, the renewables SLD_REN_FCST, each saved as CSV. Their lines
are in any order and hold several areas, runs and kinds; one series is selected from each.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import ScenarioError
from zengrid.scenario.profiles import DEFAULT_PV, CalendarDay, Profiles, PvSeries
from zengrid.scenario.readers import stamps
from zengrid.scenario.readers.csv_table import CsvTable

Floats = NDArray[np.float64]

TIMEZONE = "America/Los_Angeles"
LOAD_PROFILE = "caiso"
_TIME = "INTERVALSTARTTIME_GMT"


def read_caiso(
    load: Path,
    renewables: Path | None = None,
    area: str = "CA ISO-TAC",
    run: str | None = None,
    solar_peak_kw: float = 0.75,
) -> Profiles:
    """Read the shape of the demand (profile ``caiso``, mean 1 kW) and of the solar output.

    Parameters
    ----------
    load, renewables:
        Exports of SLD_FCST and SLD_REN_FCST for the same days.
    area:
        TAC_AREA_NAME whose demand is used.
    run:
        MARKET_RUN_ID to use (ACTUAL, DAM, ...); not needed if a file holds only one.
    solar_peak_kw:
        Output per rated kW that the highest solar value of the file stands for. [kW]

    Raises
    ------
    ScenarioError
        A file is invalid; the message names it, the line, the column and what is permitted.
    """
    demand, calendar = _series(CsvTable(load), {"TAC_AREA_NAME": area, "MARKET_RUN_ID": run})
    if not demand.any():
        raise ScenarioError(f'{load}, column "MW": all values are 0; needed: a demand')
    load_kw = {LOAD_PROFILE: demand / demand.mean()}
    if renewables is None:
        return Profiles(load_kw, {}, calendar)
    solar, solar_calendar = _series(
        CsvTable(renewables), {"RENEWABLE_TYPE": "Solar", "MARKET_RUN_ID": run}, "TRADING_HUB"
    )
    if calendar != solar_calendar:
        raise ScenarioError(
            f"{renewables}: its whole days are {solar_calendar[0].label} to {solar_calendar[-1].label}; "
            f"needed: {calendar[0].label} to {calendar[-1].label}, as in {load.name}"
        )
    if not solar.any():
        raise ScenarioError(f'{renewables}, column "MW": all values are 0; needed: some solar output')
    return Profiles(load_kw, {DEFAULT_PV: PvSeries(solar * (solar_peak_kw / solar.max()), 1.0)}, calendar)


def _series(table: CsvTable, wanted: dict[str, str | None], parts: str = "") -> tuple[Floats, tuple[CalendarDay, ...]]:
    """Select one series in MW ``(day, step)``; if ``parts`` names a column, add up the series of its values."""
    rows = np.arange(len(table))
    for column, value in wanted.items():
        cells = np.array(table.text(column))
        present = sorted(set(cells[rows].tolist()))
        if value is None and len(present) > 1:
            raise ScenarioError(f"{table.path}: {column} is {', '.join(present)}; needed: data.market_run, one of them")
        rows = rows[cells[rows] == (present[0] if value is None else value)]
        if not len(rows):
            raise ScenarioError(f'{table.path}: no line has {column} "{value}"; there are: {", ".join(present)}')
    megawatts = table.numbers("MW")
    minutes = stamps.dates(table, _TIME, TIMEZONE)
    names = np.array(table.text(parts))[rows] if parts else np.zeros(len(rows), dtype="U1")
    total: Floats | None = None
    shared: tuple[CalendarDay, ...] = ()
    for name in sorted(set(names.tolist())):
        chosen = rows[names == name]
        chosen = chosen[np.argsort(minutes[chosen], kind="stable")]
        step = stamps.even_step(table, _TIME, minutes[chosen], chosen)
        part, calendar = stamps.whole_days(table.path, minutes[chosen], step)
        values = megawatts[chosen][part].reshape(len(calendar), -1)
        if total is not None and (calendar != shared or values.shape != total.shape):
            raise ScenarioError(
                f'{table.path}: {parts} "{name}" covers other times; needed: the same for every {parts}'
            )
        total, shared = values if total is None else total + values, calendar
    assert total is not None  # there is a line, so there is a name
    return total, shared
