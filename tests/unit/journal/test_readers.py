"""Readers while the market runs: they see whole slots without a gap, and never stop the writer."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import pairwise

from support.journal_records import begin, changed, record, roster
from zengrid.journal import Journal, RunView
from zengrid.journal.audit import audit

SLOTS = 600
HOMES = 50


def read_all(run: RunView) -> list[int]:
    return [made.position for made in run.records(limit=SLOTS)]


def read_blocks(run: RunView) -> list[int]:
    assert audit(run) == []
    return [int(position) for block in run.blocks() for position in block["position"]]


def read_home(run: RunView) -> list[int]:
    return run.home("h7")["position"].tolist()  # type: ignore[no-any-return]


def test_readers_see_a_growing_run_without_a_gap(place: str) -> None:
    pattern = record(HOMES)
    problems: list[BaseException] = []
    seen: dict[str, list[int]] = {}
    started = threading.Barrier(4)

    def read(how: Callable[[RunView], list[int]]) -> None:
        try:
            with Journal.open(place, read_only=True) as journal:
                run = journal.run("market-1")
                counts = seen.setdefault(how.__name__, [])
                started.wait(30)
                while not counts or counts[-1] < SLOTS:
                    positions = how(run)
                    assert positions == list(range(len(positions)))
                    counts.append(len(positions))
        except BaseException as error:  # noqa: BLE001 - handed to the test
            problems.append(error)
            started.abort()

    with Journal.open(place) as journal:
        run = begin(journal)
        run.commit(pattern, roster(HOMES))
        readers = [threading.Thread(target=read, args=(how,)) for how in (read_all, read_blocks, read_home)]
        for reader in readers:
            reader.start()
        started.wait(30)
        for position in range(1, SLOTS):
            run.commit(changed(pattern, position=position, day=position // 96, slot=position % 96))
        for reader in readers:
            reader.join(30)
    assert problems == []
    assert len(seen) == 3
    for counts in seen.values():
        assert counts[-1] == SLOTS
        assert all(earlier <= later for earlier, later in pairwise(counts))


def test_a_reader_in_the_middle_of_its_reading_does_not_stop_the_writer(place: str) -> None:
    pattern = record(HOMES)
    with Journal.open(place) as journal, Journal.open(place, read_only=True) as other:
        run = begin(journal)
        run.commit(pattern, roster(HOMES))
        connection = other._database.connect()
        connection.execute("BEGIN")
        connection.execute("SELECT position FROM zengrid_slot").fetchall()
        for position in range(1, 300):
            run.commit(changed(pattern, position=position, day=position // 96, slot=position % 96))
        assert connection.execute("SELECT count(*) FROM zengrid_slot").fetchone()[0] in (1, 300)
        connection.close()
        assert other.run().count() == 300
