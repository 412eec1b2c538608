"""How often one client may ask: token buckets."""

from __future__ import annotations

from dataclasses import dataclass

CLIENTS = 10_000
"""Clients remembered; those that have asked least recently are forgotten."""


@dataclass(slots=True)
class _Bucket:
    left: float
    at: float


class RateLimit:
    """A bucket of tokens for each client that fills up at a steady rate. Pure: the time is an argument.

    Parameters
    ----------
    per_s:
        Requests a second in the long run; 0 for no limit.
    burst_s:
        A client that was quiet may ask at once for as much as it could in so many seconds. [s]
    """

    def __init__(self, per_s: float, burst_s: float = 5.0) -> None:
        self.per_s = per_s
        self._full = max(per_s * burst_s, 1.0)
        self._buckets: dict[str, _Bucket] = {}

    def wait_s(self, client: str, now: float) -> float:
        """Take one token; 0, or how long the client must wait for the next one. [s]"""
        if self.per_s <= 0:
            return 0.0
        bucket = self._buckets.pop(client, None) or _Bucket(self._full, now)
        self._buckets[client] = bucket
        if len(self._buckets) > CLIENTS:
            del self._buckets[next(iter(self._buckets))]
        bucket.left = min(bucket.left + (now - bucket.at) * self.per_s, self._full)
        bucket.at = now
        if bucket.left < 1.0:
            return (1.0 - bucket.left) / self.per_s
        bucket.left -= 1.0
        return 0.0
