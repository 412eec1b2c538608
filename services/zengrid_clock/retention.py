"""Deletes old days from the journal in a thread of its own, day after day, so that weeks of running fit a disk."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self

from zengrid import logs
from zengrid.errors import JournalError

if TYPE_CHECKING:
    from zengrid.journal import Journal


class Retention:
    """Prunes one run whenever a day is over. Use it with ``with``.

    Parameters
    ----------
    keep_days:
        The last one, which is not complete, counts.
    say:
        Told what went wrong: the market goes on, and the next day it is tried again.
    """

    def __init__(self, journal: Journal, run: str, keep_days: int, say: Callable[[str, logs.Level], None]) -> None:
        self._journal = journal
        self._run = run
        self._keep_days = keep_days
        self._say = say
        self._due = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._work, name="journal-retention", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended = True
        self._due.set()
        self._thread.join()

    def day_is_over(self) -> None:
        """Look at what is there to delete; several days at once, where they pass quickly."""
        self._due.set()

    def _work(self) -> None:
        from zengrid.journal.maintenance import prune

        while self._due.wait() and not self._ended:
            self._due.clear()
            try:
                prune(self._journal, self._journal.run(self._run), self._keep_days)
            except JournalError as error:
                self._say(f"old days are not deleted: {error}", "warning")
