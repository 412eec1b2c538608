"""Full disks, lost files and broken connections: a clear error, nothing lost, and the same slot again."""

from __future__ import annotations

import os
import resource
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.journal_records import begin, changed, differences, fill, record, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RunWriter, SlotRecord
from zengrid.journal.audit import audit
from zengrid.journal.database import Step, Writer

HOMES = 2000


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """No file of this process may grow beyond a size: to SQLite the same as a disk without space."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def commit_until_full(run: RunWriter, pattern: SlotRecord, most: int) -> SlotRecord:
    """Commit the same slot again and again; return the record that was refused."""
    for _ in range(most):
        made = slot_at(pattern, run.position)
        try:
            run.commit(made, roster(HOMES) if run.position == 0 else None)
        except JournalError as error:
            if f"slot {made.slot} of day {made.day} is not settled, and can be committed again" not in str(error):
                raise
            return made
    pytest.fail(f"still space after {most} slots")


def slot_at(pattern: SlotRecord, position: int) -> SlotRecord:
    return changed(pattern, position=position, day=position // 96, slot=position % 96)


@pytest.mark.parametrize("size", [2_000_000, 9_300_000])
def test_a_full_disk_loses_nothing(file: Path, size: int) -> None:
    # The second size is reached after the log was copied into the database for the first time.
    pattern = record(HOMES)
    with Journal.open(file) as journal:
        run = begin(journal)
        with largest_file(size):
            commit_until_full(run, pattern, size // 50_000)
            # The log may just have been copied into the database and leave space for one more: but not for many.
            refused = commit_until_full(run, pattern, size // 50_000)
            settled = run.count()
            assert settled == refused.position > 5
        for position in range(settled, settled + 50):
            run.commit(slot_at(pattern, position))
        assert run.count() == settled + 50
        assert audit(run) == []
        assert all(made.soc.tobytes() == pattern.soc.tobytes() for made in run.records())


@pytest.mark.slow
def test_a_full_file_system_loses_nothing(tmp_path: Path) -> None:
    mount = ["mount", "-t", "tmpfs", "-o", "size=5m", "zengrid-test", str(tmp_path)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small file system needs root and its capabilities")
    try:
        ballast = tmp_path / "ballast"
        ballast.write_bytes(bytes(2_500_000))
        with Journal.open(tmp_path / "zengrid.db") as journal:
            run = begin(journal)
            refused = commit_until_full(run, record(HOMES), 100)
            with pytest.raises(JournalError, match="disk is full"):
                run.commit(refused)
            ballast.unlink()
            run.commit(refused)
            assert run.count() == refused.position + 1
            assert audit(run) == []
        with Journal.open(tmp_path / "zengrid.db") as journal:
            assert journal.resume().position == refused.position + 1
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)


def test_a_lost_file_is_noticed_and_goes_on_when_it_is_back(file: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal)
        fill(run, homes=2, count=3)
        away = file.rename(file.with_name("away.db"))
        for _ in range(2):
            with pytest.raises(JournalError, match="slot 3 of day 0 is not settled"):
                run.commit(record(2, 3))
        away.rename(file)
        run.commit(record(2, 3))
        assert run.count() == 4


def test_a_replaced_file_is_not_written_to(file: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal)
        fill(run, homes=2, count=3)
        for path in file.parent.glob("zengrid.db*"):
            path.unlink()
        with Journal.open(file) as other:
            begin(other)
        for _ in range(2):
            with pytest.raises(JournalError, match="was replaced by another file"):
                run.commit(record(2, 3))
    with Journal.open(file) as other:
        assert other.run().count() == 0


class Unsure:
    """A writer whose connection breaks after the database has committed, before it could say so."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer

    def commit(self, steps: Sequence[Step]) -> None:
        self._writer.commit(steps)
        raise ConnectionResetError("the connection was lost")

    def close(self) -> None:
        self._writer.close()


def test_a_commit_that_reached_the_database_unseen_is_not_repeated(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=2, count=3)
    made = record(3, 3, version=2)
    run._writer = Unsure(run._open())
    with pytest.raises(JournalError, match="the connection was lost"):
        run.commit(made, roster(3, 2))
    with pytest.raises(JournalError, match="another writer settled position 3 differently"):
        run.commit(record(3, 3, version=2, seed=9), roster(3, 2))
    run.commit(made, roster(3, 2))
    run.commit(record(3, 4, version=2))
    assert run.count() == 5
    assert differences(run.records(3)[0], made) == []


@pytest.mark.slow
def test_a_lost_connection_is_opened_again(postgres: object, journal: Journal) -> None:
    if not journal.name.startswith("postgresql"):
        pytest.skip("an SQLite file has no connection to lose")
    import psycopg

    run = begin(journal)
    fill(run, homes=2, count=3)
    with psycopg.connect(postgres.url(), autocommit=True) as connection:  # type: ignore[attr-defined]
        others = "FROM pg_stat_activity WHERE datname LIKE 'journal%' AND pid <> pg_backend_pid()"
        connection.execute(f"SELECT pg_terminate_backend(pid) {others}".encode())
    made = record(2, 3)
    with pytest.raises(JournalError, match="slot 3 of day 0 is not settled"):
        run.commit(made)
    assert run.count() == 3, "readers connect again by themselves"
    run.commit(made)
    run.commit(record(2, 4))
    assert run.count() == 5
