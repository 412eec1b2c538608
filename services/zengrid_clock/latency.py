"""How long the phases of recent slots took."""

from __future__ import annotations

import numpy as np

from zengrid.wire.requests import Latency

WINDOW = 1024


class Latencies:
    """The last slots' times: price phase, battery phase, commit; and when the slots ended."""

    def __init__(self) -> None:
        self._times = np.zeros((WINDOW, 3))
        self._ended = np.zeros(WINDOW)
        self.count = 0

    def add(self, price_s: float, battery_s: float, commit_s: float, ended: float) -> None:
        """Note one slot. [s]"""
        row = self.count % WINDOW
        self._times[row] = (price_s, battery_s, commit_s)
        self._ended[row] = ended
        self.count += 1

    def summary(self) -> Latency:
        """Medians and 99th percentiles. [ms]"""
        known = self._times[: min(self.count, WINDOW)]
        if not len(known):
            known = self._times[:1]
        (p1, p2, p3), (q1, q2, q3) = (np.percentile(known, p, axis=0) * 1e3 for p in (50, 99))
        return Latency(
            price_p50_ms=p1, price_p99_ms=q1, battery_p50_ms=p2, battery_p99_ms=q2, commit_p50_ms=p3, commit_p99_ms=q3
        )

    def slots_per_s(self, now: float) -> float:
        """Rate over the recent slots, falling while none is settled."""
        known = min(self.count, WINDOW)
        if known < 2:
            return 0.0
        first = self._ended[(self.count - known) % WINDOW]
        return float((known - 1) / max(now - first, 1e-9))
