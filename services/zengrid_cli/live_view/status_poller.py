"""Asks a market for its status repeatedly, also while its clock is away for some time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Self

from zengrid.bus.market_client import MarketClient
from zengrid.errors import ZengridError
from zengrid.wire.queries import HomesStatus, Status

MANY_HOMES = 200
MANY_HOMES_INTERVAL_S = 2.0
"""How often more than ``MANY_HOMES`` homes are asked for: their columns are long. [s]"""


class StatusPoller:
    """The last known status of a market. Use it with ``with``."""

    def __init__(self, run: str, endpoint: str, certs: Path | None = None) -> None:
        self.run = run
        self.endpoint = endpoint
        self.certs = certs
        self.status: Status | None = None
        self.homes: HomesStatus | None = None
        self.error: ZengridError | None = None
        """Why the last request had no reply; None if it had one"""
        self._client: MarketClient | None = None
        self._replied_at = time.monotonic()
        self._homes_at = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._client is not None:
            self._client.__exit__(None, None, None)

    def poll(self, timeout_s: float = 1.0) -> bool:
        """Ask once; return whether the clock replied."""
        now = time.monotonic()
        many = self.homes is not None and len(self.homes.homes) > MANY_HOMES
        homes = not many or now >= self._homes_at + MANY_HOMES_INTERVAL_S
        try:
            if self._client is None:
                self._client = MarketClient(self.run, self.endpoint, certs=self.certs, timeout_s=timeout_s)
            self.status = self._client.control("status", homes=homes)
        except ZengridError as error:
            self.error = error
            return False
        self.error = None
        self._replied_at = now
        if self.status.homes is not None:
            self.homes, self._homes_at = self.status.homes, now
        return True

    @property
    def away_s(self) -> float | None:
        """How long the clock has not replied; None while it does. [s]"""
        return None if self.error is None else time.monotonic() - self._replied_at


def last_lines(path: Path | None, count: int = 3) -> list[str]:
    """The end of a file of events."""
    if path is None:
        return []
    try:
        return path.read_text(encoding="utf-8").splitlines()[-count:]
    except FileNotFoundError:
        return []
