"""Plain CSV: units and dates are understood, and each kind of bad file gives its one precise error."""

# ruff: noqa: DTZ001 -- stamps without an offset are what is tested
from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from zengrid.errors import ScenarioError
from zengrid.scenario import Days, Scenario

OnCsv = Callable[..., Scenario]

HOURS = [f"{hour:02d}:00" for hour in range(24)]
LOS_ANGELES = "site: {latitude: 36, longitude: -119, timezone: America/Los_Angeles}"


def day(cells: dict[int, str] | None = None, header: str = "time,a_load_kw", value: str = "1.0") -> str:
    """A typical day whose lines (by number in the file) can be replaced."""
    lines = [header, *(f"{hour},{value}" for hour in HOURS)]
    for line, text in (cells or {}).items():
        lines[line - 1] = text
    return "\n".join(lines) + "\n"


def stamps(start: datetime, count: int, step: int = 60) -> list[datetime]:
    return [start + timedelta(minutes=step * i) for i in range(count)]


def dated(times: list[datetime], header: str = "time,a_load_kw") -> str:
    return "\n".join([header, *(f"{time:%Y-%m-%dT%H:%M},{i % 24}" for i, time in enumerate(times))]) + "\n"


@pytest.mark.parametrize(
    ("column", "factor"), [("a_load_kw", 1.0), ("a_load_w", 1e-3), ("a_load_kwh", 1.0), ("a_load_wh", 1e-3)]
)
def test_units_are_told_by_the_column(on_csv: OnCsv, column: str, factor: float) -> None:
    load_kw = Days(on_csv(day(header=f"time,{column}", value="7"))).day(0).load_kw
    np.testing.assert_allclose(load_kw, 7 * factor)


def test_energies_count_for_the_step_of_the_file(on_csv: OnCsv) -> None:
    lines = [f"{i // 4:02d}:{i % 4 * 15:02d},0.5" for i in range(96)]
    load_kw = Days(on_csv("time,a_load_kwh\n" + "\n".join(lines))).day(0).load_kw
    np.testing.assert_allclose(load_kw, 2.0)


@pytest.mark.parametrize(
    ("column", "data", "factor"),
    [
        ("a_pv_kw", ", pv_rated_kw: 4", 0.25),
        ("a_pv_kw", ", pv_rated_kw: {a: 2}", 0.5),
        ("pv_kw", ", pv_rated_kw: 4", 0.25),
        ("pv_w_per_kw", "", 1e-3),
        ("a_pv_w_per_kw", "", 1e-3),
    ],
)
def test_pv_is_scaled_by_its_rated_power(on_csv: OnCsv, column: str, data: str, factor: float) -> None:
    scenario = on_csv(day(header=f"time,a_load_kw,{column}", value="1,2"), data=data)
    pv_kw = Days(scenario.with_(**{"homes.0.pv_kw": 6})).day(0).pv_kw
    np.testing.assert_allclose(pv_kw, 2 * factor * 6)


def test_measured_days_are_cut_to_whole_days_and_labelled(on_csv: OnCsv) -> None:
    days = Days(on_csv(dated(stamps(datetime(2024, 2, 28, 13), 24 * 4))))
    assert (days.count, days.label(0), days.date(1), days.label(2)) == (3, "Thu 29 Feb 2024", (3, 1), "Sat 2 Mar 2024")
    assert days.label(3) == "Thu 29 Feb 2024, round 2"
    np.testing.assert_array_equal(days.day(0).load_kw[:, 0], (np.arange(24) + 11) % 24)
    np.testing.assert_array_equal(days.day(4).load_kw, days.day(1).load_kw)


def test_measured_days_are_split_by_day_or_by_month(on_csv: OnCsv) -> None:
    text = dated(stamps(datetime(2024, 1, 1), 24 * 60))
    by_day, by_month = Days(on_csv(text)), Days(on_csv(text, "split: {evaluation_months: [2]}"))
    assert by_day.evaluation(15).tolist() == list(range(3, 60, 4))
    assert by_month.evaluation(29).tolist() == list(range(31, 60))
    for days in (by_day, by_month):
        seen = {number % 60 for number in days.training(200).tolist()}
        assert not seen & {number % 60 for number in days.evaluation(200).tolist()}
        assert len(set(days.training(200).tolist())) == 200
    assert by_month.training(3).tolist() == [0, 10, 20]


def test_a_split_that_leaves_nothing_is_told(on_csv: OnCsv) -> None:
    days = Days(on_csv(dated(stamps(datetime(2024, 1, 1), 48)), "split: {evaluation_months: [7]}"))
    with pytest.raises(ScenarioError, match=r"no day is left for evaluation; the data has 2 days in months 1"):
        days.evaluation(1)


def test_stamps_with_offset_are_put_on_standard_time(on_csv: OnCsv) -> None:
    """Over a clock change no hour is lost or doubled: 8:00 UTC is midnight in Los Angeles all year round."""
    start = datetime(2024, 3, 9, 8, tzinfo=UTC)
    utc = [f"{start + timedelta(hours=i):%Y-%m-%dT%H:%MZ},{i % 24}" for i in range(72)]
    local = ZoneInfo("America/Los_Angeles")
    offset = [f"{(start + timedelta(hours=i)).astimezone(local).isoformat()},{i % 24}" for i in range(72)]
    for lines in (utc, offset):
        days = Days(on_csv("time,a_load_kw\n" + "\n".join(lines), LOS_ANGELES))
        assert (days.count, days.label(0)) == (3, "Sat 9 Mar 2024")
        np.testing.assert_array_equal(days.day(1).load_kw[:, 0], np.arange(24))


def test_empty_lines_quotes_and_byte_order_marks_do_no_harm(on_csv: OnCsv) -> None:
    plain = Days(on_csv(day())).day(0).load_kw
    for text in ("\ufeff" + day(), day().replace("\n", "\r\n"), day().replace("05:00,1.0\n", '\n"05:00","1.0"\n\n')):
        np.testing.assert_array_equal(Days(on_csv(text)).day(0).load_kw, plain)


MAY = dated(stamps(datetime(2024, 5, 1), 24))
SHIFT = MAY.replace("0,", "0-07:00,").replace("T09:00-07", "T08:00-08")
SPRING = [*stamps(datetime(2024, 3, 10), 2), *stamps(datetime(2024, 3, 10, 3), 30)]
AUTUMN = [*stamps(datetime(2024, 11, 3), 2), *stamps(datetime(2024, 11, 3, 1), 30)]
QUARTERS = [*stamps(datetime(2024, 11, 3), 8, 15), *stamps(datetime(2024, 11, 3, 1), 120, 15)]
HOLE = [*stamps(datetime(2024, 5, 1), 5), *stamps(datetime(2024, 5, 1, 7), 30)]
DOUBLE = [*stamps(datetime(2024, 5, 1), 5), *stamps(datetime(2024, 5, 1, 4), 30)]
BACK = [*stamps(datetime(2024, 5, 1), 12), *stamps(datetime(2024, 5, 1, 4), 30)]
HALF = [*stamps(datetime(2024, 5, 1), 5), datetime(2024, 5, 1, 4, 30), *stamps(datetime(2024, 5, 1, 5), 30)]

BAD = {
    "empty": ("", r"data.csv: the file is empty; needed: a header line and at least one whole day"),
    "header only": ("time,a_load_kw\n", r"data.csv: only a header; needed: at least one whole day"),
    "semicolons": (day().replace(",", ";"), r'line 1: columns are separated by ";"; permitted: ","'),
    "no time": (day(header="when,a_load_kw"), r'line 1: column "time" is missing; there are: when, a_load_kw'),
    "column twice": (day(header="time,a_load_kw,a_load_kw", value="1,1"), r'column "a_load_kw" appears twice'),
    "two units": (day(header="time,a_load_kw,a_load_w", value="1,1"), r'"a_load_w" is given in two units'),
    "unknown unit": (day(header="time,a_load_mw"), r'line 1: column "a_load_mw" has no known unit'),
    "no unit": (day(header="time,a_load"), r'line 1: column "a_load" has no known unit'),
    "unit of PV on a load": (day(header="time,a_load_w_per_kw"), r'column "a_load_w_per_kw" has no known unit'),
    "no name": (day(header="time,load_kw"), r'column "load_kw" has no known unit'),
    "only PV": (day(header="time,pv_w_per_kw"), r"line 1: no column holds a load"),
    "PV of unknown size": (day(header="time,a_load_kw,a_pv_kw", value="1,1"), r'"a_pv_kw" .*needed: data.pv_rated_kw'),
    "NaN": (day({6: "04:00,nan"}), r'line 6, column "a_load_kw": nan is out of range; permitted: a number from 0 up$'),
    "infinite": (day({6: "04:00,inf"}), r'line 6, column "a_load_kw": inf is out of range'),
    "negative": (day({9: "07:00,-0.5"}), r'line 9, column "a_load_kw": -0.5 is out of range; permitted: a number'),
    "missing value": (day({9: "07:00,"}), r'line 9, column "a_load_kw": the value is missing; permitted'),
    "text": (day({9: "07:00,n/a"}), r'line 9, column "a_load_kw": "n/a" is not a number; permitted'),
    "too few values": (day({9: "07:00"}), r"line 9: 1 values; needed: 2, as in the header"),
    "too many values": (day({9: "07:00,1,2"}), r"line 9: 3 values; needed: 2"),
    "missing hour": (day().replace("07:00,1.0\n", ""), r'line 2, column "time": .*a whole day in equal steps'),
    "wrong hour": (day({9: "07:30,1"}), r'line 9, column "time": "07:30" does not fit; .*so 07:00 for line 9'),
    "no time of day": (day({9: "7 am,1"}), r'line 9, column "time": "7 am" does not fit'),
    "no date": (MAY.replace("2024-05-01T07:00", "May 1st"), r'line 9, column "time": "May 1st" is not a time'),
    "some with offset": (MAY.replace("T07:00", "T07:00Z"), r"line 9.*permitted: an offset .* or on none"),
    "offset changes": (SHIFT, r"line 11.*needed: data.timezone"),
    "seconds": (MAY.replace("T07:00", "T07:00:30"), r"line 9.*permitted: whole minutes"),
    "hole": (dated(HOLE), r'line 7, column "time": 2024-05-01 07:00 after 2024-05-01 04:00: .* 05:00 is missing'),
    "double": (dated(DOUBLE), r'line 7, column "time": 2024-05-01 04:00 appears twice'),
    "out of order": (dated(BACK), r"line 14.*2024-05-01 04:00 after 2024-05-01 11:00 is out of order"),
    "step changes": (dated(HALF), r"line 7.*the step changes; permitted: one line every 60 min"),
    "odd step": (dated(stamps(datetime(2024, 5, 1), 300, 7)), r"line 2.*every 7 min; permitted: a step"),
    "off the hour": (dated(stamps(datetime(2024, 5, 1, 0, 20), 48)), r"line 2.*2024-05-01 00:20 and then every 60 min"),
    "one line": (dated(stamps(datetime(2024, 5, 1), 1)), r"one time only; needed: at least one whole day"),
    "no whole day": (dated(stamps(datetime(2024, 5, 1, 5), 30)), r"from 2024-05-01 05:00 to .* there is no whole day"),
    "spring": (dated(SPRING), r"line 4.*2024-03-10 03:00 after 2024-03-10 01:00: daylight saving skips an hour"),
    "autumn": (dated(AUTUMN), r"line 4.*2024-11-03 01:00 after 2024-11-03 01:00: daylight saving repeats an hour"),
    "autumn, quarters": (dated(QUARTERS), r"line 10.*2024-11-03 01:00 after 2024-11-03 01:45: daylight saving repeats"),
}  # fmt: skip


@pytest.mark.parametrize("site", ["", LOS_ANGELES], ids=["no zone", "zone"])
@pytest.mark.parametrize("kind", BAD)
def test_each_bad_file_gives_its_one_error(on_csv: OnCsv, kind: str, site: str) -> None:
    if kind == "offset changes" and site:
        pytest.skip("a known zone makes it good")
    text, message = BAD[kind]
    scenario = on_csv(text, site)
    with pytest.raises(ScenarioError, match=message) as caught:
        Days(scenario)
    assert len(str(caught.value).splitlines()) == 1
    assert "data.csv" in str(caught.value)


def test_an_hour_missing_on_another_sunday_is_no_clock_change(on_csv: OnCsv) -> None:
    hole = [*stamps(datetime(2024, 3, 17), 2), *stamps(datetime(2024, 3, 17, 3), 30)]
    with pytest.raises(ScenarioError, match="2024-03-17 02:00 is missing"):
        Days(on_csv(dated(hole), LOS_ANGELES))


def test_a_file_that_is_not_there_is_told(on_csv: OnCsv) -> None:
    with pytest.raises(ScenarioError, match=r"gone.csv: cannot be read \(No such file"):
        Days(on_csv(day()).with_(**{"data.path": "gone.csv"}))


def test_bytes_are_no_csv(on_csv: OnCsv) -> None:
    scenario = on_csv(day())
    scenario.data.files(60)[0].write_bytes(b"time,a_load_kw\n\xff\xfe\x00")
    with pytest.raises(ScenarioError, match=r"data.csv: is not a CSV file in UTF-8"):
        Days(scenario)


def test_unknown_time_zones_are_refused(on_csv: OnCsv) -> None:
    text = MAY.replace("0,", "0Z,")
    with pytest.raises(ScenarioError, match=r'data.timezone = "Mars/Olympus": permitted: an IANA time zone'):
        Days(on_csv(text, data=", timezone: Mars/Olympus"))
