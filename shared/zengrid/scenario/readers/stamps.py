"""Converts time stamps of measured data into whole days of equal steps; errors name the line.

Every day has 24 hours. Stamps with an offset from UTC are converted to the standard time of their zone, all year round,
so no measurement is dropped or repeated. Stamps without an offset are used as they are, and must not skip or repeat.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import ScenarioError
from zengrid.scenario.profiles import CalendarDay
from zengrid.scenario.readers.csv_table import CsvTable

Minutes = NDArray[np.int64]

DAY = 1440
_EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 -- stamps without offset are counted as they stand
_SUNDAY = 6


def zone(name: str, where: str) -> tzinfo:
    """Return the time zone of a name; ``where`` is the field that names it, for errors."""
    from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

    try:
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ScenarioError(f'{where} = "{name}": permitted: an IANA time zone, such as America/Los_Angeles') from None


def clock_times(table: CsvTable, column: str) -> int | None:
    """The step of a typical day, whose stamps are 00:00, 00:15, ... without a date; None if they are dates. [min]"""
    cells = table.text(column)
    if len(cells[0].strip()) > len("00:00"):
        return None
    step = DAY // len(cells)
    for row, cell in enumerate(cells):
        wanted = f"{row * step // 60:02d}:{row * step % 60:02d}"
        if cell.strip().zfill(5) != wanted or DAY % len(cells):
            steps = f"a whole day in equal steps from 00:00, so {wanted} for line {row + 2} of {len(cells)} lines"
            raise table.error(row, column, f'"{cell}" does not fit; permitted: {steps}')
    return step


def dates(table: CsvTable, column: str, timezone: str | None) -> Minutes:
    """Stamps as minutes since 1970, in the standard time of their zone if they have an offset. [min]"""
    given: list[datetime] = []
    for row, cell in enumerate(table.text(column)):
        try:
            given.append(datetime.fromisoformat(cell.strip()))
        except ValueError:
            permitted = "ISO 8601, such as 2024-04-15T13:00 or 2024-04-15T20:00Z, or a typical day from 00:00 to 23:45"
            raise table.error(row, column, f'"{cell}" is not a time; permitted: {permitted}') from None
    aware = given[0].tzinfo is not None
    for row, stamp in enumerate(given):
        if (stamp.tzinfo is not None) != aware:
            raise table.error(
                row, column, f"{stamp} differs from line 2; permitted: an offset from UTC on all lines or on none"
            )
    if aware:
        given = _standard_time(table, column, given, timezone)
    seconds = np.array([(stamp - _EPOCH) // timedelta(seconds=1) for stamp in given], dtype=np.int64)
    if (seconds % 60).any():
        row = int(np.argmax(seconds % 60 > 0))
        raise table.error(row, column, f"{given[row]} does not fall on a whole minute; permitted: whole minutes")
    return seconds // 60


def _standard_time(table: CsvTable, column: str, given: list[datetime], timezone: str | None) -> list[datetime]:
    if timezone is not None:
        local = zone(timezone, "data.timezone")
        moment = given[0].astimezone(local)
        offset = (moment.utcoffset() or timedelta()) - (moment.dst() or timedelta())
    else:
        offsets = {stamp.utcoffset() for stamp in given}
        if len(offsets) > 1:
            row = next(i for i, stamp in enumerate(given) if stamp.utcoffset() != given[0].utcoffset())
            raise table.error(
                row, column, f"{given[row]}: the offset from UTC changes; needed: data.timezone, an IANA time zone"
            )
        offset = given[0].utcoffset() or timedelta()
    return [(stamp.astimezone(UTC) + offset).replace(tzinfo=None) for stamp in given]


def even_step(
    table: CsvTable, column: str, minutes: Minutes, rows: NDArray[np.intp], timezone: str | None = None
) -> int:
    """Return the step between stamps; raises ScenarioError if one is missing, repeated or out of order. [min]

    ``rows`` are the rows of the table that hold the stamps.
    """
    if len(minutes) < 2:
        raise ScenarioError(f"{table.path}: one time only; needed: at least one whole day")
    steps = np.diff(minutes)
    kinds, counts = np.unique(steps, return_counts=True)
    step = int(kinds[np.argmax(counts)])
    for before in np.flatnonzero(steps != step)[:1]:
        row, found = int(rows[before + 1]), int(steps[before])
        last, this = _time(minutes[before]), _time(minutes[before + 1])
        if abs(found - step) == 60 and _clocks_changed(this, timezone):  # clocks move by an hour
            change = "skips an hour" if found > step else "repeats an hour"
            permitted = "times with their offset from UTC (2024-03-10T10:00Z), or standard time all year"
            raise table.error(row, column, f"{this} after {last}: daylight saving {change}; permitted: {permitted}")
        if found == 0:
            raise table.error(row, column, f"{this} appears twice; permitted: each time once")
        if found < 0:
            raise table.error(row, column, f"{this} after {last} is out of order; permitted: increasing times")
        fault = f"{_time(minutes[before] + step)} is missing" if found % max(step, 1) == 0 else "the step changes"
        raise table.error(row, column, f"{this} after {last}: {fault}; permitted: one line every {step} min")
    if step <= 0 or DAY % step or int(minutes[0]) % step:
        this = _time(minutes[0])
        permitted = "a step that divides the day into equal parts, counted from midnight"
        raise table.error(int(rows[0]), column, f"{this} and then every {step} min; permitted: {permitted}")
    return step


def whole_days(path: Path, minutes: Minutes, step: int) -> tuple[slice, tuple[CalendarDay, ...]]:
    """Return the part of the stamps that forms whole days from midnight to midnight, and the dates of these days."""
    start = int(-minutes[0] % DAY) // step
    count = (len(minutes) - start) * step // DAY
    if count < 1:
        first, last = _time(minutes[0]), _time(minutes[-1])
        raise ScenarioError(
            f"{path}: from {first} to {last} there is no whole day; needed: at least one from midnight on"
        )
    first_day = _EPOCH + timedelta(minutes=int(minutes[start]))
    days = [first_day + timedelta(days=i) for i in range(count)]
    calendar = tuple(CalendarDay(day.month, day.day, f"{day:%a} {day.day} {day:%b} {day:%Y}") for day in days)
    return slice(start, start + count * DAY // step), calendar


def _time(minutes: int | np.int64) -> str:
    return f"{_EPOCH + timedelta(minutes=int(minutes)):%Y-%m-%d %H:%M}"


def _clocks_changed(stamp: str, timezone: str | None) -> bool:
    moment = datetime.fromisoformat(stamp)
    if timezone is None:
        # Without a zone: in most places, clocks change early on a Sunday morning.
        return moment.weekday() == _SUNDAY and moment.hour <= 4
    local = zone(timezone, "data.timezone")
    noon = moment.replace(hour=12, tzinfo=local)
    return (noon - timedelta(days=1)).utcoffset() != noon.utcoffset()
