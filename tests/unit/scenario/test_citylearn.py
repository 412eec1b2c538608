"""CityLearn building files, and the scenario fontana that plays them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.errors import ScenarioError
from zengrid.scenario import Days, Scenario, dumps, load, loads
from zengrid.scenario.readers.citylearn import read_citylearn

Write = Callable[[str, str], Path]

HEADER = "month,hour,day_type,non_shiftable_load,solar_generation"


def building(lines: dict[int, str] | None = None, header: str = HEADER) -> str:
    """Two whole days behind one hour of the day before; lines can be replaced by their number."""
    rows = [header, "7,24,7,0.5,0"]
    for day in range(2):
        rows += [f"8,{hour},{day + 1},{hour + 100 * day},{hour * 10}" for hour in range(1, 25)]
    for line, text in (lines or {}).items():
        rows[line - 1] = text
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    "header",
    [HEADER, "Month,Hour,Day Type,Equipment Electric Power [kWh],Solar Generation [W/kW]"],
    ids=["names", "titles"],
)
def test_whole_days_begin_at_hour_1(write: Write, tmp_path: Path, header: str) -> None:
    write("Building_2.csv", building(header=header))
    write("Building_10.csv", building(header=header))
    write("weather.csv", "not,read\n")
    profiles = read_citylearn(tmp_path)
    assert list(profiles.load_kw) == ["building_2", "building_10"]
    assert [day.label for day in profiles.calendar] == ["Mon 1 Aug", "Tue 2 Aug"]
    np.testing.assert_array_equal(profiles.load_kw["building_2"][1], np.arange(101, 125))
    np.testing.assert_allclose(profiles.pv["building_2"].power_kw[0], np.arange(1, 25) * 0.01)


BAD = {
    "missing hour": ({5: "8,4,1,1,0"}, r'Building_1.csv, line 5, column "hour": hour 4 comes after hour 2; permitted'),
    "double hour": ({5: "8,2,1,1,0"}, r'line 5, column "hour": hour 2 appears twice; permitted: hour 3'),
    "hour 25": ({5: "8,25,1,1,0"}, r'line 5, column "hour": 25 is out of range; permitted: 1 to 24'),
    "month 13": ({5: "13,3,1,1,0"}, r'line 5, column "month": 13 is out of range; permitted: 1 to 12'),
    "day type 9": ({5: "8,3,9,1,0"}, r'line 5, column "day_type": 9 is out of range; permitted: 1 to 8'),
    "NaN": ({5: "8,3,1,nan,0"}, r'line 5, column "non_shiftable_load": nan is out of range'),
    "missing": ({5: "8,3,1,,0"}, r'line 5, column "non_shiftable_load": the value is missing'),
    "negative load": ({5: "8,3,1,-1,0"}, r'line 5, column "non_shiftable_load": -1 is out of range'),
    "negative sun": ({5: "8,3,1,1,-2"}, r'line 5, column "solar_generation": -2 is out of range'),
    "no column": ({1: "month,hour,day_type,load,sun"}, r'line 1: column "non_shiftable_load" is missing; there are'),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_each_bad_file_gives_its_one_error(write: Write, tmp_path: Path, kind: str) -> None:
    lines, message = BAD[kind]
    write("Building_1.csv", building(lines))
    with pytest.raises(ScenarioError, match=message) as caught:
        read_citylearn(tmp_path)
    assert len(str(caught.value).splitlines()) == 1


def test_files_of_different_days_are_refused(write: Write, tmp_path: Path) -> None:
    write("Building_1.csv", building())
    write("Building_2.csv", building().replace("\n8,", "\n9,"))
    with pytest.raises(ScenarioError, match=r"Building_2.csv: its days are not those of Building_1.csv"):
        read_citylearn(tmp_path)


def test_less_than_a_day_is_refused(write: Write, tmp_path: Path) -> None:
    write("Building_1.csv", "\n".join(building().splitlines()[:20]))
    with pytest.raises(ScenarioError, match=r"19 hours hold no whole day"):
        read_citylearn(tmp_path)


def test_a_folder_without_buildings_says_where_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"holds no Building_\*.csv. .*CityLearn Challenge 2022"):
        Days(load("fontana", data=tmp_path))


@pytest.fixture(scope="module")
def scenario(fontana: Path) -> Scenario:
    return load("fontana", data=fontana)


@pytest.fixture(scope="module")
def days(scenario: Scenario) -> Days:
    return Days(scenario)


class TestFontana:
    def test_it_is_a_year_of_whole_days(self, days: Days) -> None:
        assert days.count == 364
        assert (days.label(0), days.label(153), days.label(363)) == ("Mon 1 Aug", "Sun 1 Jan", "Sun 30 Jul")
        assert days.label(364) == "Mon 1 Aug, round 2"
        assert (days.date(0), days.date(363)) == ((8, 1), (7, 30))

    def test_days_are_what_the_files_say(self, days: Days, fontana: Path) -> None:
        def rows(number: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
            return np.loadtxt(fontana / f"Building_{number}.csv", delimiter=",", skiprows=2 + 24 * 10, max_rows=24)

        day = days.day(10)
        for place, number in enumerate((5, 8, 3)):
            np.testing.assert_array_equal(day.load_kw[:, place], rows(number)[:, 3])
            np.testing.assert_allclose(day.pv_kw[:, place], rows(number)[:, 4] * 4e-3, rtol=1e-12)
        others = sum(rows(number)[:, 3] for number in (1, 2, 7, 9, 10, 13, 16, 17))
        np.testing.assert_allclose(day.consumer_kw[:, 0], 1.24 * others, rtol=1e-12)

    def test_months_are_kept_for_evaluation(self, days: Days) -> None:
        evaluation, training = days.evaluation(500), days.training(500)
        months = [{(days.date(int(number)) or (0, 0))[0] for number in numbers} for numbers in (evaluation, training)]
        assert months == [{1, 4, 7, 10}, {2, 3, 5, 6, 8, 9, 11, 12}]

    def test_a_dump_refers_to_the_data_by_path_and_content(self, scenario: Scenario, fontana: Path) -> None:
        text = dumps(scenario)
        assert str(fontana.resolve()) in text
        np.testing.assert_array_equal(Days(loads(text)).day(7).pv_kw, Days(scenario).day(7).pv_kw)
        with pytest.raises(ScenarioError, match="the content has changed"):
            Days(loads(text).with_(**{"data.sha256": "0" * 64}))

    def test_without_demand_response_the_year_is_ordinary(self, scenario: Scenario, days: Days) -> None:
        """Magnitudes a market of three homes and a small grid must have."""
        market, batch = scenario.market(), days.days(range(364))
        soc = np.broadcast_to(market.homes.soc_initial, (364, 3))
        bills, reserve_kwh, unserved = np.zeros(3), 0.0, 0.0
        for slot in range(24):
            now = type(batch)(*(array[:, slot] for array in batch))
            command = conventional(now.pv_kw, now.load_kw, market.homes)
            settled = settle(soc, Action(np.full(364, 0.05), command), now, market)
            soc = settled.soc
            bills += settled.bill.mean(axis=0)
            reserve_kwh += settled.facility_kw[:, 1].mean()
            unserved += settled.unserved_kw.sum()
        assert unserved == 0.0
        assert (bills > 0.1).all()
        assert (bills < 2.0).all()
        assert 10.0 < reserve_kwh < 100.0
