"""How long the phases of slots took."""

from __future__ import annotations

import numpy as np

from zengrid.wire.queries import Histogram, Latency

WINDOW = 1024
BOUNDS_MS = (0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 100.0, 250.0, 500.0, 1000.0, 2500.0)
"""Classes of the histograms."""


class Latencies:
    """The last slots' times: price phase, battery phase, commit; and when the slots ended."""

    def __init__(self) -> None:
        self._times = [(0.0, 0.0, 0.0)] * WINDOW
        self._ended = [0.0] * WINDOW
        self.count = 0
        self._counted = 0
        self._counts = np.zeros((len(BOUNDS_MS) + 1, 3), np.int64)
        self._sums_ms = np.zeros(3)

    def add(self, price_s: float, battery_s: float, commit_s: float, ended: float) -> None:
        """Note one slot. [s]"""
        if self.count - self._counted == WINDOW:
            self._count_up()
        row = self.count % WINDOW
        self._times[row] = (price_s, battery_s, commit_s)
        self._ended[row] = ended
        self.count += 1

    def summary(self) -> Latency:
        """Medians and 99th percentiles. [ms]"""
        known = np.array(self._times[: max(min(self.count, WINDOW), 1)])
        (p1, p2, p3), (q1, q2, q3) = (np.percentile(known, p, axis=0) * 1e3 for p in (50, 99))
        self._count_up()
        price, battery, commit = (self._histogram(column) for column in range(3))
        return Latency(
            price_p50_ms=p1, price_p99_ms=q1, battery_p50_ms=p2, battery_p99_ms=q2, commit_p50_ms=p3, commit_p99_ms=q3,
            price=price, battery=battery, commit=commit,
        )  # fmt: skip

    def _count_up(self) -> None:
        """Sort the slots since the last time into their classes; many at once cost little."""
        new = [self._times[number % WINDOW] for number in range(self._counted, self.count)]
        new_ms = np.array(new).reshape(-1, 3) * 1e3
        self._counted = self.count
        self._sums_ms += new_ms.sum(axis=0)
        for column in range(3):
            classes = np.searchsorted(BOUNDS_MS, new_ms[:, column])
            self._counts[:, column] += np.bincount(classes, minlength=len(self._counts))

    def _histogram(self, column: int) -> Histogram:
        counts = tuple(self._counts[:, column].tolist())
        return Histogram(bounds_ms=BOUNDS_MS, counts=counts, sum_ms=float(self._sums_ms[column]))

    def slots_per_s(self, now: float) -> float:
        """Rate over the recent slots, falling while none is settled."""
        known = min(self.count, WINDOW)
        if known < 2:
            return 0.0
        first = self._ended[(self.count - known) % WINDOW]
        return float((known - 1) / max(now - first, 1e-9))
