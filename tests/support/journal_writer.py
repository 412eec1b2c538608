"""``python -m support.journal_writer``: settles slots into a journal as fast as it can, until it is killed."""

from __future__ import annotations

import sys

from support.journal_records import begin, changed, record, roster
from zengrid.journal import Journal

HOMES = (40, 300)
"""Homes of odd and even roster versions."""
ROSTER_SLOTS = 37
"""How long each roster is in force."""
PATTERNS = 8


def version_at(position: int) -> int:
    """The roster in force at a position."""
    return 1 + position // ROSTER_SLOTS


def homes_at(position: int) -> int:
    """How many homes take part at a position."""
    return HOMES[version_at(position) % 2]


def main(place: str) -> None:
    """Go on with the run, or begin it; tell each position once it is committed."""
    patterns = {homes: [record(homes, i) for i in range(PATTERNS)] for homes in HOMES}
    with Journal.open(place) as journal:
        run = journal.resume() if journal.runs() else begin(journal)
        while True:
            position = run.position
            version, homes = version_at(position), homes_at(position)
            made = changed(
                patterns[homes][position % PATTERNS],
                position=position,
                day=position // 96,
                slot=position % 96,
                roster_version=version,
            )
            run.commit(made, roster(homes, version) if position % ROSTER_SLOTS == 0 else None)
            sys.stdout.write(f"{position}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1])
