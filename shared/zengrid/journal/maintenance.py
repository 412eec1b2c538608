"""Maintains a journal while its market runs: deletes old days and makes copies."""

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
"""Values of each array of homes that one transaction deletes: the market may have to wait for it."""
CHUNK_SLOTS = 500


@dataclass(frozen=True, slots=True)
class Pruned:
    """Result of pruning a run: number of slots and rosters deleted."""

    run: str
    kept_from: int
    """position of the first slot that is kept"""
    slots: int
    rosters: int


def prune(journal: Journal, run: RunView, keep_days: int, *, progress: Callable[[int], None] | None = None) -> Pruned:
    """Delete all but the last days of a run, even while its clock writes it in the same process.

    Another process must hold ``Journal.alone``. The sums of the deleted slots are kept. If pruning is interrupted, the
    journal stays sound, and the next call continues.

    Parameters
    ----------
    keep_days:
        Number of days to keep, at least 1. The last day counts even if it is not complete.
    progress:
        Called with the number of slots deleted so far.
    """
    if keep_days < 1:
        raise JournalError(
            f"keep_days = {keep_days}: must be at least 1, because the market continues from the last day"
        )
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
        # Leave a running market as much time as the deletion took.
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
    """Copy a whole journal, as it is at this moment, into a new SQLite file, while the market continues.

    The copy is a journal like any other. If copying fails, or the copy does not pass ``audit``, no file is left.

    Returns
    -------
    int
        Slots copied.
    """
    if target.exists():
        raise JournalError(f"back-up = {target}: exists already; choose a new name")
    if not target.parent.is_dir():
        raise JournalError(f"back-up = {target}: there is no directory {target.parent}")
    part = target.with_name(f"{target.name}.part")
    part.unlink(missing_ok=True)
    try:
        copied = journal.copy_to(part, progress)
        with Journal.open(part, read_only=True) as copy:
            wrong = copy.check() + [text for info in copy.runs() for text in audit(copy.run(info.id))]
        if wrong:
            raise JournalError(
                f"back-up = {target}: the copy is damaged, and perhaps {journal.name} is too: {wrong[0]}"
            )
        part.rename(target)
    except OSError as error:
        raise JournalError(f"back-up = {target}: {error}") from error
    finally:
        for path in (part, *(part.with_name(part.name + end) for end in ("-wal", "-shm", "-journal"))):
            path.unlink(missing_ok=True)
    return copied
