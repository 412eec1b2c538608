"""A writer killed at any point: every slot it told of is there, once, complete, and the next writer goes on."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from support.journal_records import differences, record, roster
from support.journal_writer import PATTERNS, homes_at, version_at
from zengrid.journal import Journal
from zengrid.journal.audit import audit

TESTS = Path(__file__).parents[2]


def kill_writer(place: str, after: int) -> int:
    """Let a writer settle some slots, kill it while it goes on, and return the last position it told of."""
    path = os.pathsep.join([str(TESTS), *sys.path])
    child = subprocess.Popen(
        [sys.executable, "-m", "support.journal_writer", place],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    with child:
        assert child.stdout is not None
        assert child.stderr is not None
        for _ in range(after):
            if not child.stdout.readline():
                pytest.fail(f"the writer died by itself:\n{child.stderr.read()}")
        child.send_signal(signal.SIGKILL)
        told = child.stdout.read().splitlines()
    # The last line can be cut off, as anything can.
    whole = [int(line) for line in told[:-1]]
    return whole[-1] if whole else -1


def check(place: str, told: int) -> None:
    with Journal.open(place, read_only=True) as journal:
        run = journal.run()
        assert run.count() > told
        assert audit(run) == []
        assert [start for start, _ in run.rosters()] == list(range(0, run.count(), 37))
        for since in range(0, run.count(), 1000):
            for made in run.records(since):
                homes, version = homes_at(made.position), version_at(made.position)
                assert made.roster_version == version
                # What a record holds follows from its position, but for the times it was copied.
                expected = record(homes, made.position % PATTERNS)
                assert set(differences(made, expected)) <= {"position", "day", "slot", "roster_version"}
        assert run.roster() == roster(homes_at(run.count() - 1), version_at(run.count() - 1))


def test_nothing_told_is_lost_when_the_writer_is_killed(place: str) -> None:
    chance = random.Random(20240415)
    told = -1
    for _ in range(4):
        told = max(told, kill_writer(place, chance.randrange(1, 400)))
    check(place, told)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_nothing_told_is_lost_in_many_kills(place: str) -> None:
    chance = random.Random(7)
    told = -1
    for _ in range(25):
        told = max(told, kill_writer(place, chance.randrange(1, 500)))
    check(place, told)
