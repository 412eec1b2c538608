"""The market as it happens: server-sent events, and the same over a WebSocket."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Awaitable
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Response, WebSocket
from starlette.requests import HTTPConnection
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect

from zengrid.errors import ZengridError
from zengrid.wire.queries import HistoryReply
from zengrid.wire.slots import PublicSlot
from zengrid_gateway.access import Access
from zengrid_gateway.feed import Slot
from zengrid_gateway.frames import Frame, Frames
from zengrid_gateway.link import Link, MarketLink
from zengrid_gateway.problems import Problem, documented

CLIENTS = 1000
"""Most clients at a time."""
RESUMED = 1000
"""Most slots sent to a client that comes back; the newest count."""
STUCK_S = 20.0
"""A client that takes nothing for so long is given up."""

router = APIRouter(tags=["live"])
socket_router = APIRouter()
"""Apart, since FastAPI's bearer scheme knows requests alone."""

EXAMPLE = """\
event: market
data: {"present":true}

event: slot
id: 89
data: {"v":1,"run":"main","day":3,"slot":17,"position":89,"hour":17.0,"dt_h":1.0,"state":"running","buy_price":0.07,...}

"""


async def _frames(connection: HTTPConnection) -> Frames:
    frames: Frames = connection.app.state.frames
    if frames.clients >= CLIENTS:
        raise Problem("busy", f"clients = {frames.clients}: {CLIENTS} may watch at a time; try again later")
    return frames


LiveFrames = Annotated[Frames, Depends(_frames)]
Since = Annotated[
    int | None, Query(ge=-1, le=2**53, description="Position of the slot seen last; what followed is sent first.")
]


class EventStream(Response):
    """Sends frames until the client goes, is stuck, or the gateway stops."""

    media_type = "text/event-stream"

    def __init__(self, frames: AsyncGenerator[Frame]) -> None:
        super().__init__(headers={"cache-control": "no-store", "x-accel-buffering": "no"})
        del self.headers["content-length"]
        self._frames = frames

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""

        async def stream() -> None:
            await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
            async for frame in self._frames:
                async with asyncio.timeout(STUCK_S):
                    await send({"type": "http.response.body", "body": frame.events, "more_body": True})
            await send({"type": "http.response.body", "body": b""})

        async def gone() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass

        await _first(stream(), gone())
        await self._frames.aclose()


@router.get(
    "/v1/live",
    response_class=EventStream,
    status_code=200,
    responses={
        200: {"content": {"text/event-stream": {"schema": {"type": "string"}, "example": EXAMPLE}}},
        **documented("busy", "invalid"),
    },
)
async def live(
    frames: LiveFrames,
    link: Link,
    since: Since = None,
    last_event_id: Annotated[
        int | None,
        Header(ge=-1, le=2**53, description="Sent by a client that comes back: the id it has seen last."),
    ] = None,
) -> Response:
    """Each slot as it is settled, as server-sent events.

    `slot` carries what the clock publishes, its id is the position in the journal. `market` tells whether the market
    is there. A client that comes back with `Last-Event-ID` gets what it missed. At most ten frames a second are sent,
    of at most ten slots each: where the market is faster, positions jump, and `/v1/history` has what lies between.
    """
    if last_event_id is not None:
        since = last_event_id
    return EventStream(frames.follow(since, await missed(link, since)))


@socket_router.websocket("/v1/live")
async def live_socket(socket: WebSocket, link: Link, since: Since = None) -> None:
    """The same over a WebSocket: messages `{"event": "slot", "id": 89, "data": {...}}`; nothing is read from it."""
    try:
        frames = await _frames(socket)
        access: Access = socket.app.state.access
        access.check(socket, "read")
    except Problem as problem:
        await socket.close(1008, problem.detail[:120])
        return
    await socket.accept()
    following = frames.follow(since, await missed(link, since))

    async def stream() -> None:
        async for frame in following:
            for message in frame.messages:
                async with asyncio.timeout(STUCK_S):
                    await socket.send_text(message)
        await socket.close(1001)

    async def gone() -> None:
        while (await socket.receive())["type"] != "websocket.disconnect":
            pass

    await _first(stream(), gone())
    await following.aclose()


async def _first(*parts: Awaitable[None]) -> None:
    """Run both until one ends; a client that is gone or stuck is no error."""
    tasks = [asyncio.ensure_future(part) for part in parts]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            expected = isinstance(result, OSError | WebSocketDisconnect | asyncio.CancelledError)
            if isinstance(result, BaseException) and not expected:
                raise result


async def missed(link: MarketLink, since: int | None) -> list[Slot]:
    """Slots that a client missed and that are not in memory any more."""
    latest = link.feed.position
    if since is None or since >= latest:
        return []
    start, end = max(since + 1, latest - RESUMED), link.feed.first
    if start >= end:
        return []
    with contextlib.suppress(Problem, ZengridError):
        return await link.ask(lambda client: _slots(client.history(start, end - start)))
    return []


def _slots(reply: HistoryReply) -> list[Slot]:
    """Slots of the clock's reply, encoded as it publishes them."""
    fields = set(PublicSlot.model_fields)
    return [Slot(slot.position, slot.model_dump_json(include=fields).encode()) for slot in reply.slots]
