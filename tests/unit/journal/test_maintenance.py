"""Old days go, copies are made, and the market that writes meanwhile loses nothing."""

from __future__ import annotations

import json
import os
import resource
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from support.commands import run_zengrid
from support.journal_records import begin, changed, differences, fill, record, records, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RunTotals
from zengrid.journal.audit import audit
from zengrid.journal.maintenance import backup, prune

TESTS = Path(__file__).parents[2]


@contextmanager
def writing(place: str) -> Iterator[subprocess.Popen[str]]:
    """Another process that settles slots into a journal as fast as it can."""
    path = os.pathsep.join([str(TESTS), *sys.path])
    child = subprocess.Popen(
        [sys.executable, "-m", "support.journal_writer", place],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    try:
        yield child
    finally:
        child.kill()
        child.communicate()


def until(child: subprocess.Popen[str], position: int) -> None:
    """Wait until it has settled that slot."""
    assert child.stdout is not None
    for line in child.stdout:
        if int(line) >= position:
            return
    pytest.fail("the writer died by itself")


def same(left: RunTotals, right: RunTotals) -> bool:
    return (
        left.slots == right.slots
        and left.homes == right.homes
        and left.grid_fallbacks == right.grid_fallbacks
        and np.allclose(list(left.market().values()), list(right.market().values()), rtol=1e-12)
        and np.allclose(
            list(left.of_homes(left.homes).values()), list(right.of_homes(right.homes).values()), rtol=1e-12
        )
    )


def test_pruned_days_are_gone_and_their_sums_are_kept(journal: Journal, place: str) -> None:
    run = begin(journal)
    fill(run, homes=4, count=250)
    run.commit(record(6, 250, version=2), roster(6, 2))
    for made in records(6, 99, since=251, version=2):
        run.commit(made)
    before = run.totals()
    assert before.homes == roster(6).homes
    done = prune(journal, run, keep_days=2)
    # 350 slots are 3 whole days and 62 slots of the fourth.
    assert (done.kept_from, done.slots) == (192, 192)
    assert (run.count(), run.kept_from()) == (350, 192)
    assert same(run.totals(), before)
    assert audit(run) == []
    assert [made.position for made in run.records(limit=3)] == [192, 193, 194]
    assert len(run.home("h5")["bill"]) == 100
    assert prune(journal, run, keep_days=2).slots == 0
    done = prune(journal, run, keep_days=1)
    assert (done.kept_from, done.rosters) == (288, 1)
    with pytest.raises(JournalError, match="keep_days = 0: must be at least 1"):
        prune(journal, run, keep_days=0)
    run.close()
    with Journal.open(place) as again:
        resumed = again.resume()
        assert resumed.position == 350
        resumed.commit(record(6, 350, version=2), totals=resumed.totals())
        assert same(resumed.totals(350), before)
        assert resumed.totals().slots == 351
        assert audit(resumed) == []


def test_a_copy_is_made_while_a_writer_goes_on(file: Path, tmp_path: Path) -> None:
    with writing(str(file)) as child:
        until(child, 200)
        with Journal.open(file) as journal:
            for number in range(2):
                copied = backup(journal, tmp_path / f"copy{number}.db")
                with Journal.open(tmp_path / f"copy{number}.db", read_only=True) as copy:
                    assert copied == copy.run().count() > 200
        refused = run_zengrid("journal", "prune", "--keep-days", "1", "--journal", str(file))
        assert refused.exit_code == 1
        assert "is being written by process" in refused.stderr
    with Journal.open(file) as journal:
        before = journal.size()
        with journal.alone():
            prune(journal, journal.run(), keep_days=1)
            journal.vacuum()
        assert journal.size() < before / 2
        assert audit(journal.run()) == []
        assert journal.resume().position == journal.run().count()


def test_a_copy_is_a_journal_like_any_other(journal: Journal, tmp_path: Path) -> None:
    run = begin(journal)
    written = fill(run, homes=3, count=250)
    assert backup(journal, tmp_path / "copy.db") == 250
    with Journal.open(tmp_path / "copy.db") as copy:
        resumed = copy.resume()
        assert all(not differences(*pair) for pair in zip(written, resumed.records(), strict=True))
        resumed.commit(record(3, 250))
    assert sorted(path.name for path in tmp_path.glob("copy*")) == ["copy.db"]
    with pytest.raises(JournalError, match="exists already"):
        backup(journal, tmp_path / "copy.db")
    with pytest.raises(JournalError, match="there is no directory"):
        backup(journal, tmp_path / "nowhere" / "copy.db")


def test_a_copy_that_does_not_fit_leaves_nothing(file: Path, tmp_path: Path) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=500, count=30)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, before[1]))
        try:
            with pytest.raises(JournalError, match=r"back-up = .*copy\.db: cannot be written"):
                backup(journal, tmp_path / "copy.db")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert list(tmp_path.glob("copy*")) == []
        assert backup(journal, tmp_path / "copy.db") == 30


def test_a_damaged_last_slot_is_reported(file: Path, tmp_path: Path) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=3, count=20)
    connection = sqlite3.connect(file)
    connection.execute("UPDATE zengrid_slot SET soc = substr(soc, 1, 16) WHERE position = 19")
    connection.commit()
    connection.close()
    with (
        Journal.open(file) as journal,
        pytest.raises(JournalError, match=r"damaged: in the last slot of run 'market-1' .*soc holds 2 of 3 homes"),
    ):
        journal.resume()
    found = run_zengrid("journal", "verify", "--journal", str(file), "--json")
    assert found.exit_code == 1
    assert "soc" in json.loads(found.stdout)["runs"][0]["findings"][-1]
    refused = run_zengrid("journal", "backup", str(tmp_path / "copy.db"), "--journal", str(file))
    assert refused.exit_code == 1
    assert not (tmp_path / "copy.db").exists()


def test_damaged_pages_are_reported(file: Path) -> None:
    with Journal.open(file) as journal:
        fill(begin(journal), homes=200, count=50)
    whole = bytearray(file.read_bytes())
    middle = len(whole) // 2
    whole[middle : middle + 8192] = os.urandom(8192)
    file.write_bytes(whole)
    found = run_zengrid("journal", "verify", "--journal", str(file))
    assert found.exit_code == 1
    assert (
        "malformed" in found.stdout + found.stderr
        or "database:" in found.stdout + found.stderr
        or "damaged" in found.stdout + found.stderr
    )


def test_the_commands_say_what_they_did(file: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal)
        fill(run, homes=3, count=200)
    said = run_zengrid("journal", "prune", "--keep-days", "1", "--journal", str(file), "--vacuum")
    assert said.exit_code == 0
    assert "market-1: 192 slots deleted, kept from position 192" in said.stdout
    said = run_zengrid("journal", "verify", "--journal", str(file))
    assert (said.exit_code, said.stdout) == (0, "market-1: 200 slots, the first 192 of them pruned: sound\n")
    assert run_zengrid("journal", "verify", "--journal", str(file), "--run", "nobody").exit_code == 1
    assert run_zengrid("journal", "prune", "--keep-days", "0", "--journal", str(file)).exit_code == 2
    assert (
        run_zengrid("journal", "prune", "--keep-days", "1", "--journal", str(file.with_name("none.db"))).exit_code == 1
    )
    assert not file.with_name("none.db").exists()
    with Journal.open(file) as journal:
        resumed = journal.resume()
        made = record(3, 200)
        resumed.commit(changed(made, profit=made.profit + 1e-6))
    said = run_zengrid("journal", "verify", "--journal", str(file))
    assert said.exit_code == 1
    assert "position 200 (day 2, slot 8): profit: off by 1e-06" in said.stdout
