"""CAISO OASIS exports: one series out of unsorted lines of many areas, runs and kinds."""

from __future__ import annotations

import random
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from zengrid.errors import ScenarioError
from zengrid.scenario import Days, load
from zengrid.scenario.profiles import DEFAULT_PV
from zengrid.scenario.readers.caiso import read_caiso

Write = Callable[[str, str], Path]

LOAD = (
    "INTERVALSTARTTIME_GMT,INTERVALENDTIME_GMT,LOAD_TYPE,OPR_DT,OPR_HR,OPR_INTERVAL,MARKET_RUN_ID,TAC_AREA_NAME,LABEL,"
    "XML_DATA_ITEM,POS,MW,EXECUTION_TYPE,GROUP"
)
SUN = (
    "INTERVALSTARTTIME_GMT,INTERVALENDTIME_GMT,OPR_DT,OPR_HR,OPR_INTERVAL,TRADING_HUB,RENEWABLE_TYPE,LABEL,"
    "XML_DATA_ITEM,MARKET_RUN_ID,GROUP,MW"
)
START = datetime(2024, 3, 9, 8, tzinfo=UTC)
DAYS = 3


def times() -> list[tuple[str, str]]:
    """Three days from midnight, Pacific standard time, over the change to daylight saving."""
    hours = [START + timedelta(hours=i) for i in range(24 * DAYS)]
    return [(f"{h:%Y-%m-%dT%H:%M:%S}-00:00", f"{h + timedelta(hours=1):%Y-%m-%dT%H:%M:%S}-00:00") for h in hours]


def demand(run: str = "ACTUAL", area: str = "CA ISO-TAC") -> list[str]:
    return [
        f"{begin},{end},0,2024-03-09,1,0,{run},{area},Total {run},SYS_FCST,1,{20_000 + 100 * (i % 24)},{run},1"
        for i, (begin, end) in enumerate(times())
    ]


def renewables(kind: str, hub: str, run: str = "ACTUAL") -> list[str]:
    return [
        f"{begin},{end},2024-03-09,1,0,{hub},{kind},Renewable,RENEW,{run},1,{max(0, 6 - abs(i % 24 - 12)) * 100}"
        for i, (begin, end) in enumerate(times())
    ]


def table(header: str, *series: list[str]) -> str:
    lines = [line for part in series for line in part]
    random.Random(4).shuffle(lines)
    return "\n".join([header, *lines]) + "\n"


def test_lines_are_picked_sorted_and_normalised(write: Write) -> None:
    load_file = write("load.csv", table(LOAD, demand(), demand(area="PGE-TAC")))
    sun_file = write(
        "sun.csv", table(SUN, *(renewables(kind, hub) for kind in ("Solar", "Wind") for hub in ("NP15", "SP15")))
    )
    profiles = read_caiso(load_file, sun_file)
    shape = 20_000.0 + 100 * np.arange(24)
    np.testing.assert_allclose(profiles.load_kw["caiso"], np.tile(shape / shape.mean(), (DAYS, 1)))
    power, rated = profiles.pv[DEFAULT_PV]
    assert (power.max(), rated) == (0.75, 1.0)
    np.testing.assert_allclose(power[1], np.maximum(0, 6 - abs(np.arange(24) - 12)) / 6 * 0.75)
    assert [day.label for day in profiles.calendar] == ["Sat 9 Mar 2024", "Sun 10 Mar 2024", "Mon 11 Mar 2024"]


def test_a_scenario_uses_the_measured_days(write: Write) -> None:
    write("load.csv", table(LOAD, demand()))
    write("sun.csv", table(SUN, renewables("Solar", "NP15")))
    path = write(
        "market.yaml",
        "name: x\ntariff: [{from: 00:00, price: 1}]\nfacilities: [{name: b, max_kw: 9, b: 1}]\n"
        "homes: [{id: a, pv_kw: 4, load: {scale: 2}}]\n"
        "data: {kind: caiso, load: load.csv, renewables: sun.csv}\n",
    )
    scenario = load(path)
    days = Days(scenario)
    assert days.days(range(DAYS)).load_kw.mean() == pytest.approx(2.0)
    assert days.day(0).pv_kw.max() == pytest.approx(3.0)


def test_a_run_is_chosen_where_there_are_several(write: Write) -> None:
    file = write("load.csv", table(LOAD, demand("ACTUAL"), demand("DAM")))
    with pytest.raises(ScenarioError, match=r"MARKET_RUN_ID is ACTUAL, DAM; needed: data.market_run, one of them"):
        read_caiso(file)
    assert read_caiso(file, run="DAM").count == DAYS


def first(old: str, new: str) -> Callable[[list[str]], list[str]]:
    return lambda lines: [lines[0].replace(old, new), *lines[1:]]


BAD: dict[str, tuple[Callable[[list[str]], list[str]], str]] = {
    "missing hour": (lambda lines: lines[:30] + lines[31:], r"line 32.*2024-03-10 07:00 after .*06:00 is missing"),
    "double": (lambda lines: lines[:30] + lines[29:], r"line 32.*2024-03-10 05:00 appears twice"),
    "text": (first("20000", "?"), r'line 2, column "MW": "\?" is not a number'),
    "negative": (first("20000", "-1"), r'line 2, column "MW": -1 is out of range'),
    "no time": (first("2024-03-09T08:00:00-", "x"), r'line 2, column "INTERVALSTARTTIME_GMT": .*is not a time'),
    "all zero": (lambda lines: [_zero(line) for line in lines], r'column "MW": all values are 0; needed: a demand'),
}


def _zero(line: str) -> str:
    cells = line.split(",")
    cells[-3] = "0"
    return ",".join(cells)


@pytest.mark.parametrize("kind", BAD)
def test_each_bad_file_gives_its_one_error(write: Write, kind: str) -> None:
    change, message = BAD[kind]
    file = write("load.csv", "\n".join([LOAD, *change(demand())]) + "\n")
    with pytest.raises(ScenarioError, match=message) as caught:
        read_caiso(file)
    assert len(str(caught.value).splitlines()) == 1


def test_areas_that_are_not_there_are_told(write: Write) -> None:
    with pytest.raises(ScenarioError, match=r'no line has TAC_AREA_NAME "XX"; there are: CA ISO-TAC'):
        read_caiso(write("load.csv", table(LOAD, demand())), area="XX")


def test_both_reports_must_be_of_the_same_days(write: Write) -> None:
    load_file = write("load.csv", table(LOAD, demand()))
    sun_file = write("sun.csv", "\n".join([SUN, *renewables("Solar", "NP15")[24:]]) + "\n")
    with pytest.raises(ScenarioError, match=r"sun.csv: its whole days are Sun 10 Mar 2024 to .*needed: Sat 9 Mar 2024"):
        read_caiso(load_file, sun_file)


def test_all_hubs_must_be_there_all_the_time(write: Write) -> None:
    load_file = write("load.csv", table(LOAD, demand()))
    sun_file = write("sun.csv", "\n".join([SUN, *renewables("Solar", "NP15"), *renewables("Solar", "SP15")[:48]]))
    with pytest.raises(ScenarioError, match=r'TRADING_HUB "SP15" covers other times'):
        read_caiso(load_file, sun_file)
