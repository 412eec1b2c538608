"""Runs: begun, resumed, finished, found, and written by one process at a time."""

from __future__ import annotations

import subprocess
import sys

import pytest

from support.journal_records import begin, differences, fill, record, records, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal


def test_a_run_goes_on_where_it_was_left(place: str) -> None:
    with Journal.open(place) as journal:
        written = fill(begin(journal), homes=3, count=5)
    with Journal.open(place) as journal:
        run = journal.resume()
        assert (run.name, run.position, run.count(), run.info.slots) == ("market-1", 5, 5, 5)
        assert run.roster() == roster(3)
        assert run.scenario() == "name: paper\n"
        last = run.last()
        assert last is not None
        assert differences(last, written[-1]) == []
        run.commit(record(3, position=5))
        assert run.count() == 6


def test_a_run_can_be_left_before_its_first_slot(journal: Journal) -> None:
    begin(journal).close()
    run = journal.resume("market-1")
    assert run.last() is None
    assert run.records() == []
    fill(run, homes=2, count=1)


def test_the_latest_unfinished_run_is_resumed(journal: Journal) -> None:
    for name in ("a", "b", "c"):
        begin(journal, name).close()
    journal.resume("c").finish()
    assert journal.resume().name == "b"
    assert journal.run().name == "c"
    assert journal.resume(1).name == "a"


def test_a_finished_run_is_over(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=2, count=2)
    run.finish()
    (info,) = journal.runs()
    assert info.finished_at is not None
    assert info.finished_at >= info.started_at
    with pytest.raises(JournalError, match="'market-1' is finished"):
        journal.resume("market-1")
    with pytest.raises(JournalError, match="is closed"):
        run.commit(record(2, position=2))


@pytest.mark.parametrize(("which", "message"), [("x", "no run 'x'"), (9, "no run 9"), (None, "no unfinished run")])
def test_an_unknown_run_is_named(journal: Journal, which: str | int | None, message: str) -> None:
    begin(journal).finish()
    with pytest.raises(JournalError, match=f"{message} .*market-1"):
        journal.resume(which)


def test_a_name_is_given_once(journal: Journal) -> None:
    begin(journal)
    with pytest.raises(JournalError, match="run 'market-1' exists already"):
        begin(journal)


def test_runs_side_by_side_do_not_mix(journal: Journal) -> None:
    first, second = begin(journal, "a"), begin(journal, "b")
    fill(first, homes=2, count=3)
    fill(second, homes=4, count=2)
    assert [info.slots for info in journal.runs()] == [3, 2]
    assert [len(made.soc) for made in first.records()] == [2, 2, 2]


def test_a_second_writer_is_refused(place: str) -> None:
    with Journal.open(place) as journal, Journal.open(place) as other:
        run = begin(journal)
        with pytest.raises(JournalError, match="'market-1' is being written by"):
            other.resume("market-1")
        run.close()
        other.resume("market-1")


def test_a_second_process_is_refused_and_told_who_writes(file: object) -> None:
    script = "import sys; from zengrid.journal import Journal; Journal.open(sys.argv[1]).resume()"
    with Journal.open(str(file)) as journal:
        begin(journal)
        import os

        done = subprocess.run([sys.executable, "-c", script, str(file)], capture_output=True, text=True, timeout=30)
        assert f"is being written by process {os.getpid()}: it has one writer at a time" in done.stderr


def test_slots_follow_one_another(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=2, count=3)
    for position in (1, 2, 4):
        with pytest.raises(JournalError, match=f"position = {position}: run 'market-1' continues at position 3"):
            run.commit(record(2, position))
    assert run.count() == 3


def test_a_slot_of_a_day_is_settled_once(journal: Journal) -> None:
    from support.journal_records import changed

    run = begin(journal)
    fill(run, homes=2, count=3)
    with pytest.raises(JournalError, match="day = 0, slot = 1: position 3 is day 0, slot 3"):
        run.commit(changed(record(2, 3), slot=1))
    run.commit(record(2, 3))
    assert [made.slot for made in run.records()] == [0, 1, 2, 3]


def test_records_are_read_in_pieces(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=1, count=20)
    assert [made.position for made in run.records(5, limit=3)] == [5, 6, 7]
    assert [made.position for made in run.records(5, 8)] == [5, 6, 7]
    assert [made.position for made in run.records(18)] == [18, 19]
    assert run.records(20) == []
    assert [made.position for made in journal.run().records(limit=2)] == [0, 1]


def test_the_positions_of_a_day_are_found(journal: Journal) -> None:
    run = begin(journal)
    for made in records(homes=1, count=200):
        run.commit(made, roster(1) if made.position == 0 else None)
    assert run.days() == range(200)
    assert run.days(1) == range(96, 200)
    assert run.days(0, 1) == range(96)
    assert run.days(3) == range(0)
