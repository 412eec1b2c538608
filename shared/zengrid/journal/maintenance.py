"""Keeps a journal fit for weeks: deletes old days, gives their space back, makes copies while the market runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from zengrid.errors import JournalError
from zengrid.journal.audit import audit
from zengrid.journal.journal import Journal
from zengrid.journal.run_view import RunView

CHUNK_VALUES = 100_000
"""Slots deleted in one transaction: so many values of each array of homes. The market waits for no more than that."""
CHUNK_SLOTS = 500


@dataclass(frozen=True, slots=True)
class Pruned:
    """What was deleted of a run."""

    run: str
    kept_from: int
    """first position that is kept"""
    slots: int
    rosters: int


def prune(journal: Journal, run: RunView, keep_days: int, *, progress: Callable[[int], None] | None = None) -> Pruned:
    """Delete all but the last days of a run, also while its clock, in the same process, writes it.

    Another process does so only with ``Journal.alone``.

    What the deleted slots add up to is kept. Whatever interrupts this, the journal is sound, and the next call goes on.

    Parameters
    ----------
    keep_days:
        The last one, which may not be complete, counts; at least 1.
    progress:
        Told how many slots were deleted so far.
    """
    if keep_days < 1:
        raise JournalError(f"keep_days = {keep_days}: at least 1, the day from which the market goes on")
    last = run.last()
    if last is None:
        return Pruned(run.name, 0, 0, 0)
    days = run.days(last.day + 1 - keep_days)
    kept_from = max(days.start, run.kept_from())
    sql = journal.statements
    steps = []
    _, summed, data = journal.query(sql.kept, (run.id,))[0]
    if data is None or summed < kept_from:
        steps.append((sql.write_totals, (kept_from, run.totals(kept_from).encode(), run.id)))
    journal.write([*steps, (sql.keep_from, (kept_from, run.id))] if kept_from > run.kept_from() else [])
    deleted = 0
    # An earlier call that was interrupted may have left some.
    first = journal.query(sql.first_position, (run.id,))[0][0]
    width = max(len(roster.homes) for _, roster in run.rosters())
    step = max(1, min(CHUNK_SLOTS, CHUNK_VALUES // max(width, 1)))
    for start in range(first, kept_from, step):
        end = min(start + step, kept_from)
        began = time.monotonic()
        journal.write([(sql.delete_slots, (run.id, start, end))])
        deleted += end - start
        if progress is not None:
            progress(deleted)
        # A running market has its turn, too.
        time.sleep(time.monotonic() - began)
    oldest = _version_at(run, kept_from)
    before = len(run.rosters())
    journal.write([(sql.delete_rosters, (run.id, oldest))])
    return Pruned(run.name, kept_from, deleted, before - sum(it.version >= oldest for _, it in run.rosters()))


def _version_at(run: RunView, position: int) -> int:
    """Version of the roster in force."""
    versions = [roster.version for start, roster in run.rosters() if start <= position]
    return versions[-1] if versions else run.rosters()[0][1].version


def backup(journal: Journal, target: Path, *, progress: Callable[[int, int], None] | None = None) -> int:
    """Copy a whole journal, as it is at this moment, into a new SQLite file; the market goes on meanwhile.

    The copy is a journal like any other: it is read, verified, exported and resumed in the same way. Nothing is left
    behind where this fails, or where what was copied does not pass ``audit``.

    Returns
    -------
    int
        Slots copied.
    """
    if target.exists():
        raise JournalError(f"back-up = {target}: exists already; give a new name")
    if not target.parent.is_dir():
        raise JournalError(f"back-up = {target}: there is no directory {target.parent}")
    part = target.with_name(f"{target.name}.part")
    part.unlink(missing_ok=True)
    try:
        copied = journal.copy_to(part, progress)
        with Journal.open(part, read_only=True) as copy:
            wrong = copy.check() + [text for info in copy.runs() for text in audit(copy.run(info.id))]
        if wrong:
            raise JournalError(f"back-up = {target}: the copy is not sound, nor is {journal.name} perhaps: {wrong[0]}")
        part.rename(target)
    except OSError as error:
        raise JournalError(f"back-up = {target}: {error}") from error
    finally:
        for path in (part, *(part.with_name(part.name + end) for end in ("-wal", "-shm", "-journal"))):
            path.unlink(missing_ok=True)
    return copied
