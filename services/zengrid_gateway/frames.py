"""What is sent to everybody who watches: frames, written once for all, at a bounded rate."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, Iterable, Sequence
from typing import NamedTuple

from zengrid_gateway.feed import Feed, Slot

PERIOD_S = 0.1
"""Shortest time between two frames."""
SENDS_PER_S = 2000.0
"""Most frames sent a second to all clients together: beyond that each of them gets fewer."""
FRAME_SLOTS = 10
"""Most slots in a frame; where more were settled in between, the newest one stands for them."""
KEPT = 32
"""Frames kept for clients that are slow for a moment; one that is slower misses some."""
QUIET_S = 15.0
"""After this time without news a frame says that the stream is still alive."""


class Frame(NamedTuple):
    """Some events, in both notations."""

    number: int
    events: bytes
    """As server-sent events."""
    messages: tuple[str, ...]
    """As WebSocket messages."""


class Frames:
    """Writes a frame when something has happened, and hands it to all clients."""

    def __init__(self, feed: Feed) -> None:
        self.clients = 0
        self._feed = feed
        self._kept: deque[Frame] = deque(maxlen=KEPT)
        self._number = 0
        self._next: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._began, self._position, self._present = feed.began, feed.position, feed.present

    async def run(self) -> None:
        """Follow the market until the gateway stops."""
        feed, seen = self._feed, -1
        while not feed.ended:
            quiet = False
            if feed.changes == seen:
                try:
                    await asyncio.wait_for(feed.changed(), QUIET_S)
                except TimeoutError:
                    quiet = True
            seen = feed.changes
            self._write(quiet=quiet)
            await asyncio.sleep(max(PERIOD_S, self.clients / SENDS_PER_S))
        self._tell()

    def _write(self, *, quiet: bool) -> None:
        """Write a frame of what has happened since the last one."""
        feed = self._feed
        if feed.began != self._began:
            self._began, self._position = feed.began, -1
        slots = feed.since(self._position) if self.clients else []
        present = feed.present if feed.present != self._present else None
        self._position, self._present = feed.position, feed.present
        if slots or present is not None or quiet:
            self._number += 1
            self._kept.append(frame(self._number, slots if len(slots) <= FRAME_SLOTS else slots[-1:], present))
            self._tell()

    def _tell(self) -> None:
        self._next.set_result(None)
        self._next = asyncio.get_running_loop().create_future()

    async def follow(self, since: int | None, missed: Sequence[Slot] = ()) -> AsyncGenerator[Frame]:
        """Frames for one client; close the iterator when it is gone.

        Parameters
        ----------
        since:
            Journal position of the slot that the client has seen last; None for a new one, who gets the latest slot.
        missed:
            Slots after it that are not in memory any more.
        """
        self.clients += 1
        try:
            if self._feed.present != self._present:
                self._write(quiet=False)  # all clients hear of the same changes
            number = self._number
            known = [slot for slot in self._feed.since(-1) if slot.position <= self._position]
            if since is None or since > self._position:
                yield frame(0, known[-1:], self._present)
            else:
                yield frame(0, [*missed, *(slot for slot in known if slot.position > since)], self._present)
            while not self._feed.ended:
                if number == self._number:
                    await asyncio.shield(self._next)
                for newer in [each for each in self._kept if each.number > number]:
                    yield newer
                    number = newer.number
        finally:
            self.clients -= 1


def frame(number: int, slots: Iterable[Slot], present: bool | None = None) -> Frame:
    """Slots, and whether the market is there, as events; a frame without either is a comment."""
    events, messages = [], []
    if present is not None:
        body = '{"present":true}' if present else '{"present":false}'
        events.append(f"event: market\ndata: {body}\n\n".encode())
        messages.append(f'{{"event":"market","data":{body}}}')
    for slot in slots:
        events.append(b"event: slot\nid: %d\ndata: %b\n\n" % slot)
        messages.append(f'{{"event":"slot","id":{slot.position},"data":{slot.payload.decode()}}}')
    return Frame(number, b"".join(events) or b": nothing new\n\n", tuple(messages))
