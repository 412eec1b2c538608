"""Writes days of a scenario as files, for analysis elsewhere or as a start for your own data."""

from __future__ import annotations

import csv
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import numpy as np

from zengrid.core.state import Exogenous
from zengrid.errors import ScenarioError
from zengrid.scenario import Days, dumps
from zengrid.scenario.files import write
from zengrid.scenario.scenario import Scenario

ProfileFormat = Literal["csv", "parquet"]

# Scenarios have no years: use one without a leap day that begins on a Monday.
_YEAR = 2001


def export_days(
    scenario: Scenario, count: int, folder: Path, kind: ProfileFormat = "csv", first: int = 0
) -> list[Path]:
    """Write the profiles of some days, and a scenario that plays them from the file.

    Parameters
    ----------
    scenario:
        The market.
    count, first:
        Number of days, and number of the first day.
    folder:
        Created if it does not exist.
    kind:
        ``csv`` writes ``profiles.csv`` for the reader of plain CSV, with a column for each home's PV and load, and
        ``scenario.yaml``, which plays exactly these days. ``parquet`` writes one row for each home and slot to
        ``homes.parquet``, one for each consumer and slot to ``consumers.parquet``, and the unchanged scenario.

    Returns
    -------
    The files written.

    Raises
    ------
    ScenarioError
        The folder cannot be written to.
    """
    numbers = list(range(first, first + count))
    days = Days(scenario)
    made = days.days(numbers)
    month, day = days.date(first) or (1, 1)
    start = datetime(_YEAR, month, day)  # noqa: DTZ001 -- profiles are on local time
    step = timedelta(minutes=scenario.slot_minutes)
    times = [start + step * i for i in range(count * scenario.slots_per_day)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if kind == "csv":
            return [_write_csv(scenario, made, times, folder), _write_replay(scenario, folder)]
        return [*_write_parquet(scenario, made, times, folder), _write(folder / "scenario.yaml", dumps(scenario))]
    except OSError as error:
        raise ScenarioError(
            f"{folder}: cannot be written to ({error.strerror}); needed: a folder to write to"
        ) from None


def _write_csv(scenario: Scenario, made: Exogenous, times: list[datetime], folder: Path) -> Path:
    columns: dict[str, np.ndarray[Any, np.dtype[np.float64]]] = {}
    for place, home in enumerate(scenario.homes):
        if home.pv_kw > 0.0:
            columns[f"{home.id}_pv_kw"] = made.pv_kw[..., place].ravel()
        columns[f"{home.id}_load_kw"] = made.load_kw[..., place].ravel()
    for place, consumer in enumerate(scenario.consumers):
        columns[f"{_profile_of(consumer.name)}_load_kw"] = made.consumer_kw[..., place].ravel()
    path = folder / "profiles.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *columns])
        # repr of a float is the shortest text that reads as the same float.
        for time, values in zip(times, np.stack(list(columns.values()), axis=-1).tolist(), strict=True):
            writer.writerow([f"{time:%Y-%m-%dT%H:%M}", *map(repr, values)])
    return path


def _write_replay(scenario: Scenario, folder: Path) -> Path:
    """Write the same market with the exported profiles and without noise."""
    fields = scenario.model_dump(mode="json", by_alias=True, exclude={"homes"})
    fields["description"] = f"Days of the scenario {scenario.name}, seed {scenario.seed}, as exported to profiles.csv."
    fields["population"] = None
    fields["homes"] = [
        home.model_dump(mode="json")
        | {"tilt_deg": None, "azimuth_deg": None, "load": {"profile": home.id, "scale": 1.0}}
        for home in scenario.homes
    ]
    fields["consumers"] = [
        {"name": consumer.name, "profiles": [_profile_of(consumer.name)], "scale": 1.0}
        for consumer in scenario.consumers
    ]
    rated_kw = {home.id: home.pv_kw for home in scenario.homes if home.pv_kw > 0.0}
    fields["data"] = {"kind": "csv", "path": "profiles.csv", "pv_rated_kw": rated_kw}
    fields["noise"] = dict.fromkeys(fields["noise"], 0.0)
    return _write(folder / "scenario.yaml", write(fields))


def _write_parquet(scenario: Scenario, made: Exogenous, times: list[datetime], folder: Path) -> list[Path]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    def table(name_field: str, names: list[str], **values: Any) -> pa.Table:
        return pa.table(
            {
                "time": pa.array(np.repeat(np.array(times, dtype="datetime64[s]"), len(names))),
                name_field: pa.array(names * len(times)),
                **{field: pa.array(array.ravel()) for field, array in values.items()},
            }
        )

    homes = table("home", list(scenario.home_ids), pv_kw=made.pv_kw, load_kw=made.load_kw)
    consumers = table("consumer", [c.name for c in scenario.consumers], load_kw=made.consumer_kw)
    paths = [folder / "homes.parquet", folder / "consumers.parquet"]
    for path, content in zip(paths, (homes, consumers), strict=True):
        pq.write_table(content, path)
    return paths


def _profile_of(consumer: str) -> str:
    """Name of a consumer's profile; the colon keeps it apart from homes' ids."""
    return f"consumer:{consumer}"


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path
