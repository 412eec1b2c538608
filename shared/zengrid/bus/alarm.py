"""Wakes a thread that waits on something without a time-out of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Alarm:
    """Calls ``ring`` at the time set last, from a thread of its own.

    Setting a later time costs nothing: the thread finds out when it wakes at the earlier one. So deadlines that are
    nearly always met, thousands a second, cost one wake-up each time the first of them would have passed.
    """

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring
        self._at = float("inf")
        self._sleeping_until = float("inf")
        self._changed = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._watch, name="alarm", daemon=True)
        self._thread.start()

    def ring_at(self, at: float) -> None:
        """Ring at this time (monotonic clock) instead of the one set before."""
        self._at = at
        if at < self._sleeping_until:
            with self._changed:
                self._changed.notify()

    def stop(self) -> None:
        """Never ring again."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def _watch(self) -> None:
        with self._changed:
            while not self._stopped:
                at = self._at
                left = at - time.monotonic()
                if left <= 0:
                    self._at = float("inf")
                    self._ring()
                    continue
                self._sleeping_until = at
                # Whoever sets an earlier time from here on sees that this thread must be woken.
                if self._at == at:
                    # An hour at most: a wait of no end cannot be given as a number of seconds.
                    self._changed.wait(min(left, 3600.0))
                self._sleeping_until = float("-inf")
