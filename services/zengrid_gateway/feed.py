"""The latest slots, in memory: what Zenoh's thread hands over, taken up by the event loop a few times a second."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any, NamedTuple

from pydantic_core import from_json

PERIOD_S = 0.05
"""Shortest time between two looks at what has arrived: a market at full speed settles a thousand slots a second."""
KEPT = 2048
"""Slots kept for clients that come back."""


class Slot(NamedTuple):
    """A settled slot as it was published."""

    position: int
    payload: bytes


class Feed:
    """Slots in order. ``push`` may be called from any thread, everything else from the event loop alone."""

    def __init__(self) -> None:
        self._arrived: deque[bytes] = deque(maxlen=KEPT)
        self._slots: deque[Slot] = deque(maxlen=KEPT)
        self._awake = False
        self.ended = False
        """Whether the gateway is about to stop; live streams end then."""
        self.latest: dict[str, Any] | None = None
        """The last slot's fields, or None before the first."""

    def open(self) -> None:
        """Belong to the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._next: asyncio.Future[None] = self._loop.create_future()

    def push(self, payload: bytes) -> None:
        """Take a slot from Zenoh's thread; wakes the event loop only if it is not about to look anyway."""
        self._arrived.append(payload)
        if not self._awake:
            self._awake = True
            self._loop.call_soon_threadsafe(self._take)

    def _take(self) -> None:
        if not self._arrived:
            self._awake = False
            if not self._arrived:
                return
            self._awake = True  # one arrived in between and found the loop still awake
        while self._arrived:
            payload = self._arrived.popleft()
            fields = from_json(payload)
            position = fields["position"]
            if self._slots and position <= self._slots[-1].position:
                if payload == self._slots[-1].payload:
                    continue  # a late joiner may be told the latest slot twice
                self._slots.clear()  # the market began anew
            self._slots.append(Slot(position, payload))
            self.latest = fields
        self._tell()
        self._loop.call_later(PERIOD_S, self._take)

    def _tell(self) -> None:
        self._next.set_result(None)
        self._next = self._loop.create_future()

    def end(self) -> None:
        """Let everybody who waits go."""
        self.ended = True
        self._tell()

    def clear(self) -> None:
        """Forget all slots: they belong to a market that is over."""
        self._slots.clear()
        self.latest = None

    def since(self, position: int) -> list[Slot]:
        """Kept slots after a position, oldest first."""
        newer: list[Slot] = []
        for slot in reversed(self._slots):
            if slot.position <= position:
                break
            newer.append(slot)
        return newer[::-1]

    async def changed(self) -> None:
        """Wait for the next slots."""
        await asyncio.shield(self._next)
