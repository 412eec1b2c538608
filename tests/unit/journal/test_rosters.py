"""Homes join and leave: whose the arrays are at every slot."""

from __future__ import annotations

import numpy as np
import pytest

from support.journal_records import begin, record, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RosterRecord, RunView
from zengrid.journal.audit import audit
from zengrid.journal.slot_columns import HOME_ARRAYS

# From each position on: how many homes, the first of them.
CHANGES = {0: (3, 0), 5: (4, 0), 9: (2, 2), 12: (3, 0)}


@pytest.fixture
def run(journal: Journal) -> RunView:
    run = begin(journal)
    version = homes = first = 0
    for position in range(15):
        changed = None
        if position in CHANGES:
            homes, first = CHANGES[position]
            version += 1
            changed = roster(homes, version, first)
        run.commit(record(homes, position, version), changed)
    return run


def test_each_slot_knows_its_roster(run: RunView) -> None:
    assert [(start, len(known.homes)) for start, known in run.rosters()] == [(0, 3), (5, 4), (9, 2), (12, 3)]
    for made in run.records():
        assert len(run.roster(made.roster_version).homes) == len(made.soc)
    assert run.roster() == roster(3, 4)
    assert run.roster(3) == roster(2, 3, 2)
    with pytest.raises(JournalError, match="no roster 9"):
        run.roster(9)


def test_blocks_end_where_the_roster_changes(run: RunView) -> None:
    blocks = list(run.blocks())
    assert [(block["position"][0], len(block)) for block in blocks] == [(0, 5), (5, 4), (9, 3), (12, 3)]
    assert [block["soc"].shape for block in blocks] == [(5, 3), (4, 4), (3, 2), (3, 3)]
    assert [len(block) for block in run.blocks(6, 10)] == [3, 1]
    assert all("soc" not in block.columns and block["facility_kw"].shape[1] == 3 for block in run.blocks(homes=False))


@pytest.mark.parametrize(
    ("home", "positions"), [("h0", [*range(9), 12, 13, 14]), ("h3", range(5, 12)), ("h2", range(15))]
)
def test_a_homes_history_is_cut_out(run: RunView, home: str, positions: range) -> None:
    history = run.home(home)
    assert history["position"].tolist() == list(positions)
    made = {known.position: known for known in run.records()}
    for name in HOME_ARRAYS:
        expected = [
            getattr(made[i], name)[run.roster(made[i].roster_version).homes.index(home)] for i in history["position"]
        ]
        assert history[name].tolist() == expected
    part = run.home(home, 4, 10)
    assert part["position"].tolist() == [i for i in positions if 4 <= i < 10]
    assert part["fallback"].dtype == np.bool_


def test_a_history_can_be_empty(run: RunView) -> None:
    assert all(len(values) == 0 for values in run.home("h3", 12).values())
    with pytest.raises(JournalError, match="home 'h9' never took part"):
        run.home("h9")


def test_a_market_can_stand_without_homes(journal: Journal) -> None:
    run = begin(journal)
    run.commit(record(0), roster(0))
    run.commit(record(2, 1, 2), roster(2, 2))
    assert audit(run) == []
    assert [block["soc"].shape for block in run.blocks()] == [(1, 0), (1, 2)]


def test_a_roster_is_stored_with_its_first_slot_or_not_at_all(journal: Journal) -> None:
    run = begin(journal)
    run.commit(record(2), roster(2))
    with pytest.raises(JournalError, match="position = 7"):
        run.commit(record(3, 7, 2), roster(3, 2))
    with pytest.raises(JournalError, match="roster_version = 2: the roster in force is version 1"):
        run.commit(record(3, 1, 2))
    assert run.rosters() == [(0, roster(2))]
    run.commit(record(3, 1, 2), roster(3, 2))
    assert len(run.rosters()) == 2


def test_a_run_starts_with_a_roster(journal: Journal) -> None:
    with pytest.raises(JournalError, match="the roster in force is version None"):
        begin(journal).commit(record(2))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (roster(2, 1), "roster.version = 1: must be above 1"),
        (RosterRecord(2, ("a", "a"), ({}, {}), ()), "2 homes must be distinct"),
        (RosterRecord(2, ("a", "b"), ({},), ()), "have a spec each"),
    ],
)
def test_a_wrong_roster_is_refused(journal: Journal, wrong: RosterRecord, message: str) -> None:
    run = begin(journal)
    run.commit(record(2), roster(2))
    with pytest.raises(JournalError, match=message):
        run.commit(record(2, 1, wrong.version), wrong)
    run.commit(record(2, 1))
