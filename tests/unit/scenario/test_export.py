"""Exported days play again, bit for bit, from the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zengrid.errors import ScenarioError
from zengrid.scenario import Days, Scenario, load
from zengrid.scenario.day_export import export_days


@pytest.mark.parametrize("name", ["paper", "village"])
@pytest.mark.parametrize("minutes", [60, 15])
def test_what_is_exported_plays_the_same_days(tmp_path: Path, name: str, minutes: int) -> None:
    scenario = load(name).with_(slot_minutes=minutes)
    written = export_days(scenario, 3, tmp_path, first=5)
    assert [path.name for path in written] == ["profiles.csv", "scenario.yaml"]
    again, days = Days(load(tmp_path / "scenario.yaml")), Days(scenario)
    assert again.count == 3
    for number in range(3):
        for left, right in zip(again.day(number), days.day(5 + number), strict=True):
            np.testing.assert_array_equal(left, right)


def test_one_day_is_a_typical_day(tmp_path: Path, paper: Scenario) -> None:
    export_days(paper, 1, tmp_path / "new" / "folder")
    again = Days(load(tmp_path / "new" / "folder" / "scenario.yaml"))
    assert again.count is None
    np.testing.assert_array_equal(again.day(9).load_kw, Days(paper).day(0).load_kw)


def test_parquet_has_a_line_for_each_home_and_slot(tmp_path: Path, paper: Scenario) -> None:
    import pyarrow.parquet as pq

    export_days(paper, 2, tmp_path, "parquet")
    homes, day = pq.read_table(tmp_path / "homes.parquet").to_pydict(), Days(paper).day(1)
    assert len(homes["home"]) == 2 * 24 * 3
    assert homes["home"][:3] == ["p1", "p2", "p3"]
    assert homes["load_kw"][72 : 72 + 6] == day.load_kw[:2].ravel().tolist()
    assert str(homes["time"][72]) == "2001-01-02 00:00:00"
    assert load(tmp_path / "scenario.yaml") == paper


def test_folders_that_cannot_be_written_are_told(paper: Scenario) -> None:
    with pytest.raises(ScenarioError, match="/dev/null/x: cannot be written to"):
        export_days(paper, 1, Path("/dev/null/x"))
