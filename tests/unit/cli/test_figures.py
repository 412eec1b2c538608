"""How figures are written, alone and in one line about a market."""

from __future__ import annotations

import pytest

from support.sample_status import agent, status
from zengrid_cli.figures import amount, change, clock_time, pace, progress
from zengrid_cli.lines import line


@pytest.mark.parametrize(("hour", "text"), [(0.0, "00:00"), (10.25, "10:15"), (23 + 55 / 60, "23:55")])
def test_times_of_day(hour: float, text: str) -> None:
    assert clock_time(hour) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (-0.0, "0.00"), (-1.234, "-1.23"), (1234.56, "1,234.6"), (-123456.7, "-123,457")],
)
def test_amounts_are_rounded_to_their_size(value: float, text: str) -> None:
    assert amount(value) == text
    assert amount(abs(value), "+") == f"+{text.lstrip('-')}"


def test_changes_are_in_percent_or_a_dash() -> None:
    assert change(62.0, 100.0) == "-38.0 %"
    assert change(-1.5, -1.0) == "-50.0 %"
    assert change(1.0, 0.001) == "–"


def test_pace_and_progress_are_written_out() -> None:
    now = status()
    assert pace(now) == "max  912 slots/s"
    assert pace(now.model_copy(update={"speed": 60.0, "slots_per_s": 0.0166})) == "60x  0.0166 slots/s"
    assert progress(now) == "day 2 14:00  slot 63 of 168"
    assert progress(now.model_copy(update={"days": None})) == "day 2 14:00  slot 63"
    assert progress(now.model_copy(update={"last": None})) == "before the first slot"


def test_a_status_fits_in_one_line() -> None:
    now = status(refused={"late": 2, "foreign": 1})
    now = now.model_copy(update={"agents": (*now.agents[:3], agent("a2", presence="away"))})
    assert line(now) == (
        "day 2 14:00  slot 63 of 168  running max  912 slots/s  sell 0.095 buy 0.070 $/kWh  "
        "demand 23.4 reserve 0.5 kW  profit 137.00 $ (+37.0 %)  bills 62.00 $ (-38.0 %)  not there: a2  refused 3"
    )
    assert line(status(journal_wait_s=12.3)).endswith("  waiting for the journal for 12 s")
