"""Holds changes to the market back until no slot is being played or written to the journal."""

from __future__ import annotations

from collections.abc import Callable

CHANGES_LIMIT = 4096
"""Most changes that wait for the end of a slot."""


class BetweenSlots:
    """Applies a change at once while the market stands between two slots, and otherwise when it does next.

    The clock closes it when a slot begins and opens it once the slot is in the journal and published.
    """

    def __init__(self) -> None:
        self.is_open = True
        self._changes: list[Callable[[], None]] = []

    @property
    def has_changes(self) -> bool:
        """Whether a change waits."""
        return bool(self._changes)

    @property
    def is_full(self) -> bool:
        """Whether too many changes wait for another one."""
        return len(self._changes) >= CHANGES_LIMIT

    def apply(self, change: Callable[[], None]) -> bool:
        """Apply a change now or as soon as possible; return whether it is done."""
        if not self.is_open:
            self._changes.append(change)
            return False
        change()
        return True

    def close(self) -> None:
        """A slot begins."""
        self.is_open = False

    def open(self) -> list[Callable[[], None]]:
        """The slot is concluded; return the changes that waited, for the caller to apply in order."""
        self.is_open = True
        changes, self._changes = self._changes, []
        return changes
