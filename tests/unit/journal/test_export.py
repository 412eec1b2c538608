"""Export: every slot and every home of every slot, to the last bit, in files others can read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from support.commands import run_zengrid
from support.journal_records import begin, record, records, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RunWriter, SlotRecord, run_view
from zengrid.journal.table_export import FACILITY_COLUMNS, HOME_COLUMNS, SLOT_COLUMNS, TableFormat, export
from zengrid_cli.commands.export_command import parse_day_range

SLOTS = 200
JOINED = 100
"""From here on there are four homes instead of three."""


@pytest.fixture
def run(file: Path) -> Any:
    with Journal.open(file) as journal:
        run = begin(journal)
        for made in (*records(3, JOINED), *records(4, SLOTS - JOINED, since=JOINED, version=2)):
            changed = {0: roster(3), JOINED: roster(4, 2)}.get(made.position)
            run.commit(made, changed)
        yield run


def read(path: Path) -> pa.Table:
    return csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)


def written(run: RunWriter) -> list[SlotRecord]:
    return run.records(limit=SLOTS)


@pytest.mark.parametrize("format", ["csv", "parquet"])
def test_slots_come_back_to_the_last_bit(run: RunWriter, tmp_path: Path, format: TableFormat) -> None:
    paths = export(run, tmp_path / "out", format)
    assert [path.name for path in paths] == [f"slots.{format}", f"homes.{format}", "scenario.yaml"]
    assert sorted(paths) == sorted((tmp_path / "out").iterdir())
    assert paths[2].read_text() == run.scenario()
    table = read(paths[0])
    made = written(run)
    assert table["run"].to_pylist() == ["market-1"] * SLOTS
    assert table["homes"].to_pylist() == [len(one.soc) for one in made]
    assert table["time_h"].to_pylist() == [one.slot * 0.25 for one in made]
    for name in ("position", "day", "slot"):
        assert table[name].to_pylist() == [getattr(one, name) for one in made]
    for name, column in SLOT_COLUMNS.items():
        assert table[name].to_pylist() == [getattr(one, column) for one in made]
    for name, column in FACILITY_COLUMNS.items():
        for i in range(3):
            assert table[name.format(i + 1)].to_pylist() == [getattr(one, column)[i] for one in made]


@pytest.mark.parametrize("format", ["csv", "parquet"])
@pytest.mark.parametrize("values", [1, 10, 250_000])
def test_homes_come_back_to_the_last_bit(
    run: RunWriter, tmp_path: Path, format: TableFormat, values: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_view, "BLOCK_VALUES", values)
    table = read(export(run, tmp_path, format)[1])
    made = written(run)
    homes = [run.roster(one.roster_version).homes for one in made]
    assert table["home"].to_pylist() == [home for names in homes for home in names]
    assert table["day"].to_pylist() == [one.day for one in made for _ in one.soc]
    assert table["time_h"].to_pylist() == [one.slot * 0.25 for one in made for _ in one.soc]
    for name, column in HOME_COLUMNS.items():
        assert table[name].to_numpy().tobytes() == np.concatenate([getattr(one, column) for one in made]).tobytes()


def test_homes_can_be_left_out(run: RunWriter, tmp_path: Path) -> None:
    assert [path.name for path in export(run, tmp_path, homes=False)] == ["slots.csv", "scenario.yaml"]


def test_only_the_given_days_are_exported(run: RunWriter, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    paths = export(run, tmp_path, days=(1, 2), progress=lambda done, total: steps.append((done, total)))
    assert set(read(paths[0])["day"].to_pylist()) == {1}
    assert len(read(paths[0])) == 96
    assert len(read(paths[1])) == 4 * 3 + 92 * 4
    assert steps == [(4, 96), (96, 96)]


def test_days_outside_of_the_run_are_refused(run: RunWriter, tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="no slot of day 7 or later is settled"):
        export(run, tmp_path, days=(7, None))
    with pytest.raises(JournalError, match="no slot of day 7 up to 8 is settled"):
        export(run, tmp_path, days=(7, 9))
    assert not list(tmp_path.glob("slots*"))


def test_a_folder_that_cannot_be_written_is_reported(run: RunWriter, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(JournalError, match=r"export to .*taken"):
        export(run, tmp_path / "taken")


def test_an_export_that_breaks_off_leaves_the_last_one(
    run: RunWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_view, "BLOCK_VALUES", 100)
    out = tmp_path / "out"
    export(run, out)
    before = (out / "slots.csv").read_bytes()

    def stop(done: int, total: int) -> None:
        if done > 60:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(run, out, progress=stop)
    assert (out / "slots.csv").read_bytes() == before
    assert sorted(path.name for path in out.iterdir()) == ["homes.csv", "scenario.yaml", "slots.csv"]


def test_run_names_are_quoted_in_csv(file: Path, tmp_path: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal, 'a "b", c')
        run.commit(record(1), roster(1))
        assert read(export(run, tmp_path / "out")[0])["run"].to_pylist() == ['a "b", c']


def test_an_unknown_format_is_refused(run: RunWriter, tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="format = 'xml': permitted: csv, parquet"):
        export(run, tmp_path, "xml")  # type: ignore[arg-type]


# ---------------------------------------------------------------- the command


def test_the_command_writes_a_folder_named_as_the_run(
    run: RunWriter, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_zengrid("export", "--format", "parquet", "--days", "0")
    assert done.exit_code == 0, done.stderr
    assert len(read(tmp_path / "market-1" / "slots.parquet")) == 96
    assert "market-1/homes.parquet" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--journal", "nowhere.db"], "zengrid export: journal nowhere.db: there is no such file"),
        (["--run", "x"], "there is no run 'x' (latest runs: market-1)"),
        (["--days", "9:"], "no slot of day 9 or later is settled"),
    ],
)
def test_the_command_says_what_is_wrong(
    run: RunWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = run_zengrid("export", *arguments)
    assert done.exit_code == 1
    assert message in done.stderr.replace("\n", " ")


@pytest.mark.parametrize(
    ("text", "days"), [(":", (0, None)), ("2:5", (2, 5)), ("2:", (2, None)), (":5", (0, 5)), ("2", (2, 3))]
)
def test_days_are_given_as_a_slice(text: str, days: tuple[int, int | None]) -> None:
    assert parse_day_range(text) == days


@pytest.mark.parametrize("text", ["", "x", "5:2", "2:2", "-1", "1:2:3", ":-4"])
def test_other_days_are_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="permitted: A:B"):
        parse_day_range(text)
