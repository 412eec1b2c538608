"""Frames: everybody gets the same, nobody waits for a slow client, and a client that comes back misses nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import aclosing

import pytest

from zengrid_gateway import frames as module
from zengrid_gateway.feed import KEPT, Feed, Slot
from zengrid_gateway.frames import FRAME_SLOTS, Frame, Frames, frame


def slot(position: int) -> bytes:
    return b'{"position":%d}' % position


def positions(*sent: Frame) -> list[int]:
    return [int(line[4:]) for each in sent for line in each.events.decode().splitlines() if line.startswith("id: ")]


@pytest.fixture
def within(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Awaitable[None]]], None]:
    """Run a coroutine, quickly."""
    monkeypatch.setattr(module, "PERIOD_S", 0.001)
    monkeypatch.setattr("zengrid_gateway.feed.PERIOD_S", 0.001)

    async def bounded(test: Callable[[], Awaitable[None]]) -> None:
        async with asyncio.timeout(10.0):
            await test()

    return lambda test: asyncio.run(bounded(test))


async def settled(feed: Feed, position: int) -> None:
    while feed.position < position:
        await feed.changed()


async def framed(live: Frames, position: int) -> None:
    async with aclosing(live.follow(position - 1)) as following:
        async for each in following:
            if position in positions(each):
                return


def test_an_event_is_written_for_streams_and_websockets() -> None:
    both = frame(1, [Slot(7, slot(7))], True)
    assert both.events == b'event: market\ndata: {"present":true}\n\nevent: slot\nid: 7\ndata: {"position":7}\n\n'
    assert both.messages == (
        '{"event":"market","data":{"present":true}}',
        '{"event":"slot","id":7,"data":{"position":7}}',
    )
    assert frame(2, []).events.startswith(b":")


def test_slots_arrive_in_order(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        got: list[int] = []
        async with aclosing(live.follow(None)) as following:
            assert positions(await anext(following)) == []
            for position in range(20):
                feed.push(slot(position))
                await settled(feed, position)
            while len(got) < 20:
                got += positions(await anext(following))
        assert got == list(range(20))
        assert live.clients == 0
        feed.end()
        await writing

    within(test)


def test_a_fast_market_is_thinned(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        async with aclosing(live.follow(None)) as following:
            await anext(following)
            for position in range(FRAME_SLOTS + 1):
                feed.push(slot(position))
            assert positions(await anext(following)) == [FRAME_SLOTS]
        feed.end()
        await writing

    within(test)


def test_a_client_that_returns_gets_what_it_missed(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        for position in range(5, 30):
            feed.push(slot(position))
        await settled(feed, 29)
        await framed(live, 29)
        async with aclosing(live.follow(10)) as following:
            assert positions(await anext(following)) == list(range(11, 30))
        older = [Slot(3, slot(3)), Slot(4, slot(4))]
        async with aclosing(live.follow(2, older)) as following:
            assert positions(await anext(following)) == list(range(3, 30))
        async with aclosing(live.follow(400)) as following:
            assert positions(await anext(following)) == [29]
        feed.end()
        await writing

    within(test)


def test_a_market_that_begins_anew(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        feed.push(slot(50))
        await settled(feed, 50)
        async with aclosing(live.follow(None)) as following:
            await anext(following)
            feed.set_present(False)
            feed.set_present(True)
            feed.push(slot(0))
            seen: list[int] = []
            while 0 not in seen:
                seen += positions(await anext(following))
        assert feed.since(-1) == [Slot(0, slot(0))]
        feed.end()
        await writing

    within(test)


def test_the_number_of_kept_slots_is_bounded(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        for position in range(KEPT + 100):
            feed.push(slot(position))
            if position % 500 == 0:
                await settled(feed, position)
        await settled(feed, KEPT + 99)
        assert feed.first >= 100
        assert len(feed.since(-1)) <= KEPT

    within(test)


def test_streams_end_with_the_gateway(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        async with aclosing(live.follow(None)) as following:
            await anext(following)
            feed.end()
            with pytest.raises(StopAsyncIteration):
                await anext(following)
        await writing

    within(test)


def test_a_market_that_goes_at_once(within: Callable[[Callable[[], Awaitable[None]]], None]) -> None:
    """It came while a frame was just out, a client joined, and it went before the next frame."""

    async def test() -> None:
        feed = Feed()
        live = Frames(feed)
        writing = asyncio.create_task(live.run())
        feed.set_present(True)
        async with aclosing(live.follow(None)) as following:
            assert (await anext(following)).events == b'event: market\ndata: {"present":true}\n\n'
            feed.set_present(False)
            assert (await anext(following)).events == b'event: market\ndata: {"present":false}\n\n'
        feed.end()
        await writing

    within(test)
