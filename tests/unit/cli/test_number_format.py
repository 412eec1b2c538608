"""How figures are written, alone and in one line about a market."""

from __future__ import annotations

import pytest

from support.sample_status import agent, status
from zengrid_cli.live_view.number_format import format_amount, format_change, format_pace, format_progress, format_time
from zengrid_cli.live_view.status_line import format_status


@pytest.mark.parametrize(("hour", "text"), [(0.0, "00:00"), (10.25, "10:15"), (23 + 55 / 60, "23:55")])
def test_times_of_day(hour: float, text: str) -> None:
    assert format_time(hour) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (-0.0, "0.00"), (-1.234, "-1.23"), (1234.56, "1,234.6"), (-123456.7, "-123,457")],
)
def test_amounts(value: float, text: str) -> None:
    assert format_amount(value) == text
    assert format_amount(abs(value), "+") == f"+{text.lstrip('-')}"


def test_changes() -> None:
    assert format_change(62.0, 100.0) == "-38.0 %"
    assert format_change(-1.5, -1.0) == "-50.0 %"
    assert format_change(1.0, 0.001) == "–"


def test_pace_and_progress() -> None:
    now = status()
    assert format_pace(now) == "max  912 slots/s"
    assert format_pace(now.model_copy(update={"speed": 60.0, "slots_per_s": 0.0166})) == "60x  0.0166 slots/s"
    assert format_progress(now) == "day 2 14:00  slot 63 of 168"
    assert format_progress(now.model_copy(update={"days": None})) == "day 2 14:00  slot 63"
    assert format_progress(now.model_copy(update={"last": None})) == "before the first slot"


def test_one_line() -> None:
    now = status(refused={"late": 2, "foreign": 1})
    now = now.model_copy(update={"agents": (*now.agents[:3], agent("a2", presence="away"))})
    assert format_status(now) == (
        "day 2 14:00  slot 63 of 168  running max  912 slots/s  import price 0.095 export price 0.070 $/kWh  "
        "demand 23.4 reserve 0.5 kW  profit 137.00 $ (+37.0 %)  bills 62.00 $ (-38.0 %)  not present: a2  refused 3"
    )
    assert format_status(status(journal_wait_s=12.3)).endswith("  waiting for the journal for 12 s")
