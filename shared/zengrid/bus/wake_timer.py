"""Wakes a thread that waits on something without a timeout of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class WakeTimer:
    """Calls ``wake`` at the time set last, from its own thread.

    Setting a later time costs nothing: the thread notices it when it wakes at the earlier one. So deadlines that are
    nearly always met, thousands per second, cost one wake-up each time the first of them would have passed.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._at = float("inf")
        self._sleeping_until = float("inf")
        self._changed = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._run, name="wake timer", daemon=True)
        self._thread.start()

    def set(self, at: float) -> None:
        """Wake at this time (monotonic clock) instead of the one set before."""
        self._at = at
        if at < self._sleeping_until:
            with self._changed:
                self._changed.notify()

    def stop(self) -> None:
        """Never wake again; end the thread."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        with self._changed:
            while not self._stopped:
                at = self._at
                left_s = at - time.monotonic()
                if left_s <= 0:
                    self._at = float("inf")
                    self._wake()
                    continue
                self._sleeping_until = at
                # From here on, whoever sets an earlier time sees that it must notify this thread.
                if self._at == at:
                    # At most an hour: ``wait`` accepts no infinite number of seconds.
                    self._changed.wait(min(left_s, 3600.0))
                self._sleeping_until = float("-inf")
