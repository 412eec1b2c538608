"""The latest slots, in memory: what Zenoh's threads hand over, taken up by the event loop a few times a second."""

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
        self._loop = asyncio.get_running_loop()
        self._arrived: deque[bytes] = deque(maxlen=KEPT)
        self._slots: deque[Slot] = deque(maxlen=KEPT)
        self._awake = False
        self._next: asyncio.Future[None] = self._loop.create_future()
        self.latest: dict[str, Any] | None = None
        """The last slot's fields, or None before the first."""
        self.latest_at = 0.0
        """When they came (monotonic clock). [s]"""
        self.changes = 0
        """How often something has happened."""
        self.began = 0
        """How often the market began anew."""
        self.present = False
        """Whether the market's clock is there."""
        self.ended = False
        """Whether the gateway is about to stop; live streams end then."""

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
            self._awake = True  # one arrived in between, and took the loop to be awake
        while self._arrived:
            self._keep(self._arrived.popleft())
        self._tell()
        self._loop.call_later(PERIOD_S, self._take)

    def _keep(self, payload: bytes) -> None:
        fields = from_json(payload)
        position = fields["position"]
        if self._slots and position <= self._slots[-1].position:
            if payload == self._slots[-1].payload:
                return  # a late joiner may be told the latest slot twice
            self.clear()
        self._slots.append(Slot(position, payload))
        self.latest, self.latest_at = fields, self._loop.time()

    def _tell(self) -> None:
        self.changes += 1
        self._next.set_result(None)
        self._next = self._loop.create_future()

    def changed(self) -> asyncio.Future[None]:
        """Done with the next slots, or when the market comes or goes; counts from this call, not from its ``await``."""
        return asyncio.shield(self._next)

    @property
    def position(self) -> int:
        """Of the latest slot; -1 before the first."""
        return self._slots[-1].position if self._slots else -1

    @property
    def first(self) -> int:
        """Position of the first slot kept; 0 where there is none."""
        return self._slots[0].position if self._slots else 0

    def since(self, position: int) -> list[Slot]:
        """Kept slots after a position, oldest first."""
        newer: list[Slot] = []
        for slot in reversed(self._slots):
            if slot.position <= position:
                break
            newer.append(slot)
        return newer[::-1]

    def clear(self) -> None:
        """Forget all slots: the market began anew."""
        self.began += 1
        self._slots.clear()
        self.latest = None

    def set_present(self, present: bool) -> None:
        """Note that the market came or went."""
        self.present = present
        self._tell()

    def end(self) -> None:
        """Let everybody who waits go."""
        self.ended = True
        self._tell()
