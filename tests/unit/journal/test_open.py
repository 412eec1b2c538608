"""What can be opened as a journal, and the clear no to everything else."""

from __future__ import annotations

import os
import random
import sqlite3
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import make_sqlite_statements
from support.journal_records import begin, fill, record
from zengrid.errors import JournalError
from zengrid.journal import Journal, RunWriter
from zengrid.journal.audit import audit


def test_a_path_and_a_url_name_the_same_file(file: Path) -> None:
    with Journal.open(f"sqlite:///{file}") as journal:
        begin(journal)
    with Journal.open(file) as journal:
        assert [info.name for info in journal.runs()] == ["market-1"]


@pytest.mark.parametrize("name", ["a b.db", "a?b#c%20.db", "ä.db"])
def test_a_file_may_have_any_name(tmp_path: Path, name: str) -> None:
    with Journal.open(tmp_path / name) as journal:
        fill(begin(journal), homes=1, count=1)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_closed_journal_is_one_file(file: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal)
        fill(run, homes=1, count=2)
        run.finish()
        assert run.count() == 2
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("mysql://u:secret@host/x", r"journal = mysql://\.\.\.: permitted: "),
        ("sqlite://", "must be a file"),
        (":memory:", "must be a file"),
        ("nowhere/zengrid.db", "there is no directory .*nowhere"),
        ("postgresql://host:port/x", r"journal = postgresql://\.\.\.: not a URL"),
    ],
)
def test_a_wrong_place_is_named(place: str, message: str) -> None:
    with pytest.raises(JournalError, match=message) as caught:
        Journal.open(place)
    assert "secret" not in str(caught.value)


def test_a_password_is_never_told() -> None:
    pytest.importorskip("psycopg")
    with pytest.raises(JournalError, match="cannot be opened") as caught:
        Journal.open("postgresql://someone:secret@localhost:1/x")
    assert "someone" in str(caught.value)
    assert "secret" not in str(caught.value)


def test_durability_is_one_of_two(file: Path) -> None:
    with pytest.raises(JournalError, match="durability = 'none': permitted: 'normal' or 'full'"):
        Journal.open(file, durability="none")  # type: ignore[arg-type]
    with Journal.open(file, durability="full") as journal:
        fill(begin(journal), homes=1, count=3)


def test_a_reader_creates_nothing(file: Path) -> None:
    with pytest.raises(JournalError, match="there is no such file"):
        Journal.open(file, read_only=True)
    assert not file.exists()
    file.touch()
    with pytest.raises(JournalError, match="not a zengrid journal: it is empty"):
        Journal.open(file, read_only=True)


def test_another_programs_database_is_left_alone(file: Path) -> None:
    connection = sqlite3.connect(file)
    connection.execute("CREATE TABLE songs (name)")
    connection.close()
    before = file.read_bytes()
    for read_only in (False, True):
        with pytest.raises(JournalError, match="not a zengrid journal: it holds the tables songs"):
            Journal.open(file, read_only=read_only)
    assert file.read_bytes() == before


def test_a_newer_journal_is_refused(file: Path) -> None:
    Journal.open(file).close()
    connection = sqlite3.connect(file)
    connection.execute("UPDATE zengrid_journal SET schema_version = 99")
    connection.commit()
    connection.close()
    with pytest.raises(JournalError, match="schema version 99; this zengrid needs 4"):
        Journal.open(file)


def test_a_file_of_anything_is_refused(file: Path) -> None:
    file.write_bytes(b"Dear diary, " * 1000)
    with pytest.raises(JournalError, match=r"zengrid\.db cannot be opened: file is not a database"):
        Journal.open(file)


@pytest.mark.parametrize("kept", [0.03, 0.2, 0.5, 0.8, 0.99])
def test_a_truncated_journal_is_refused(file: Path, kept: float) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=200, count=60)
    with file.open("r+b") as opened:
        opened.truncate(int(file.stat().st_size * kept))
    with (
        pytest.raises(JournalError, match=r"malformed|not a database|disk I/O error|damaged"),
        Journal.open(file) as journal,
    ):
        journal.resume().records()


def everything_read(run: RunWriter) -> list[object]:
    """All that a journal tells of a run, as values that can be compared."""
    records = [[value.tobytes() if isinstance(value, np.ndarray) else value for value in it] for it in run.records()]
    totals = run.totals()
    return [run.info, run.scenario(), run.rosters(), records, totals.encode()]


@pytest.mark.parametrize(
    ("homes", "slots"), [(20, 60), (300, 20)], ids=["rows within a page", "rows over several pages"]
)
def test_a_damaged_page_is_refused_or_found_by_the_audit_or_changes_nothing(file: Path, homes: int, slots: int) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=homes, count=slots)
    whole = file.read_bytes()
    with Journal.open(file) as journal:
        sound = everything_read(journal.resume())
    page = 4096
    outcomes: Counter[str] = Counter()
    for at in range(0, len(whole), page):
        file.write_bytes(whole[:at] + random.Random(at).randbytes(page) + whole[at + page :])
        try:
            with Journal.open(file) as journal:
                run = journal.resume()
                if audit(run):
                    outcomes["found"] += 1
                else:
                    assert everything_read(run) == sound, f"byte {at}: damage that nobody notices"
                    outcomes["harmless"] += 1
        except JournalError:
            outcomes["refused"] += 1
    assert outcomes.total() == len(whole) // page
    assert outcomes["found"] > 10
    assert outcomes["refused"] > 10
    assert outcomes["harmless"] < 5


@pytest.mark.parametrize("column", ["soc", "fallback", "facility_kw"])
def test_a_damaged_array_is_an_error(file: Path, column: str) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=3, count=3)
    connection = sqlite3.connect(file)
    connection.execute(f"UPDATE zengrid_slot SET {column} = x'00010200' WHERE position = 2")
    connection.commit()
    connection.close()
    with Journal.open(file) as journal:
        run = journal.run()
        assert any("is damaged" in finding for finding in audit(run))
        if column != "fallback":
            with pytest.raises(JournalError, match=f"damaged: {column} cannot be read"):
                run.last()


def test_a_gap_is_found_before_a_run_goes_on(file: Path) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=3, count=5)
    connection = sqlite3.connect(file)
    connection.execute("DELETE FROM zengrid_slot WHERE position = 2")
    connection.commit()
    connection.close()
    with Journal.open(file) as journal:
        with pytest.raises(JournalError, match="damaged: run 'market-1' holds 4 of 5 slots"):
            journal.resume()
        (finding,) = audit(journal.run())
        assert "position 1 (day 0, slot 1) is followed by position 3" in finding


def test_processes_may_create_it_at_the_same_time(place: str) -> None:
    script = """
import sys
from zengrid.journal import Journal
sys.stdin.readline()
with Journal.open(sys.argv[1]) as journal:
    journal.begin(sys.argv[2], "", seed=0, dt_h=1.0, version="").finish()
"""
    children = [
        subprocess.Popen(
            [sys.executable, "-c", script, place, f"run-{i}"], stdin=subprocess.PIPE, stderr=subprocess.PIPE
        )
        for i in range(4)
    ]
    for child in children:
        assert child.stdin is not None
        child.stdin.write(b"\n")
        child.stdin.flush()
    for child in children:
        _, problem = child.communicate(timeout=30)
        assert child.returncode == 0, problem.decode()
    with Journal.open(place) as journal:
        assert len(journal.runs()) == 4


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become someone who may not write")
@pytest.mark.parametrize("running", [True, False])
def test_a_journal_in_a_read_only_folder_can_be_read(file: Path, running: bool) -> None:
    script = """
import os, sys
import zengrid.journal.sqlite
from zengrid.journal import Journal
os.setuid(65534)
journal = Journal.open(sys.argv[1], read_only=True)
print(journal.run().count(), flush=True)
sys.stdin.readline()
print(len(journal.runs()))
"""
    for folder in [file.parent, *file.parent.parents]:
        if folder != Path("/tmp"):
            folder.chmod(0o755)
        if folder.name.startswith("pytest-of"):
            break
    with Journal.open(file) as journal:
        fill(begin(journal), homes=2, count=3)
        if not running:
            journal.close()
        with subprocess.Popen(
            [sys.executable, "-c", script, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as child:
            assert child.stdin is not None
            assert child.stdout is not None
            assert child.stdout.readline() == "3\n"
            with Journal.open(file) as again:
                begin(again, "market-2")
                child.stdin.write("\n")
                child.stdin.flush()
                assert child.stdout.readline() == "2\n"


def test_the_clock_pays_for_nothing_it_does_not_need() -> None:
    heavy = {"sqlalchemy", "pyarrow", "pandas", "pydantic", "psycopg"}
    script = f"import sys, zengrid.journal, zengrid.journal.sqlite; print(*{heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    assert done.stdout == "\n"


def test_the_statements_for_sqlite_are_up_to_date() -> None:
    written = make_sqlite_statements.TARGET.read_text(encoding="utf-8")
    assert written == make_sqlite_statements.source(), "run: python tools/make_sqlite_statements.py"


def test_columns_of_a_record_are_columns_of_the_table() -> None:
    from zengrid.journal import SlotRecord
    from zengrid.journal.slot_columns import COLUMNS

    assert SlotRecord._fields == COLUMNS
    assert record(1).encode(1)[0] == 0
