"""The gateway's link to one market: a Zenoh session that comes back by itself, and what it has told so far."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from fastapi import Depends
from starlette.requests import HTTPConnection

from zengrid import logs
from zengrid.bus.credentials import GATEWAY
from zengrid.bus.market_client import MarketClient
from zengrid.errors import BusError, SecurityError, ZengridError
from zengrid.wire.queries import Status
from zengrid_gateway.feed import Feed
from zengrid_gateway.problems import Problem

T = TypeVar("T")
Command = Literal["pause", "resume", "step", "speed"]

ATTEMPT_S = 1.0
"""Time for one attempt to reach the clock; short, so that a gateway without a market still ends at once."""
ANSWER_S = 5.0
"""Longest wait for an answer over Zenoh."""
STATUS_PERIOD_S = 1.0
"""How often the clock is asked how it stands, however many clients ask the gateway."""
FRESH_S = 0.25
"""An answer of this age is still good although a newer slot has come."""
HOMES_PERIOD_S = 0.5
"""The same for all homes, as long as somebody asks for them."""
QUESTIONS = 8
"""Questions to the clock at a time, and as many to agents and spawners; each blocks a thread."""


class MarketLink:
    """Follows a market, whether or not it is there. Use it with ``async with``; it opens at once and connects later."""

    def __init__(self, run: str, endpoint: str, certs: Path | None = None) -> None:
        self.run = run
        self.endpoint = endpoint
        self.certs = certs
        self.feed = Feed()
        self.status: Status | None = None
        """How the clock stood a moment ago, without homes; None while it is away."""
        self._status_at = 0.0
        self._status_lock = asyncio.Lock()
        self._homes: Status | None = None
        self._homes_until = 0.0
        self._homes_lock = asyncio.Lock()
        self._loop = asyncio.get_running_loop()
        self._look = asyncio.Event()
        self._client: MarketClient | None = None
        self._threads = ThreadPoolExecutor(QUESTIONS, "clock")
        self._agent_threads = ThreadPoolExecutor(QUESTIONS, "agents")

    async def __aenter__(self) -> Self:
        self._watching = asyncio.create_task(self._watch())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._watching.cancel()
        await asyncio.wait([self._watching])
        # An attempt to connect goes on in its thread for up to a second, and must not leave a session behind.
        for threads in (self._threads, self._agent_threads):
            await asyncio.to_thread(threads.shutdown, cancel_futures=True)
        if self._client is not None:
            await asyncio.to_thread(self._client.session.close)

    # ---------------------------------------------------------------- asking

    def check(self) -> MarketClient:
        """The session with the market.

        Raises
        ------
        Problem
            While the market is away.
        """
        if self._client is None:
            raise Problem("market-away", f"run {self.run}: nobody listens at {self.endpoint}; the gateway keeps trying")
        if not self.feed.present:
            raise Problem("market-away", f"run {self.run}: no clock at {self.endpoint}; the gateway waits for it")
        return self._client

    async def ask(self, question: Callable[[MarketClient], T]) -> T:
        """Ask the clock something, in a thread of its own."""
        client = self.check()
        return await self._loop.run_in_executor(self._threads, lambda: question(client))

    async def ask_agent(self, question: Callable[[MarketClient], T]) -> T:
        """Ask an agent or a spawner. Both may hang, so questions to the clock have other threads."""
        client = self.check()
        return await self._loop.run_in_executor(self._agent_threads, lambda: question(client))

    # ---------------------------------------------------------------- watching

    async def _watch(self) -> None:
        await self._connect()
        while True:
            self._look.clear()
            if self.feed.present:
                await self.refresh()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._look.wait(), STATUS_PERIOD_S)

    async def _connect(self) -> None:
        waiting = False
        while self._client is None:
            try:
                await self._loop.run_in_executor(self._threads, self._open_client)
            except (BusError, SecurityError) as error:
                if not waiting:
                    logs.print_message(f"waiting for the market: {error}", "warning")
                    waiting = True
                await asyncio.sleep(ATTEMPT_S / 4)

    def _open_client(self) -> None:
        self._client = client = MarketClient(
            self.run, self.endpoint, certs=self.certs, name=GATEWAY, timeout_s=ATTEMPT_S
        )
        client.timeout_s = ANSWER_S
        self._following = client.follow(self.feed.push)
        self._presence = client.watch(self._tell)

    def _tell(self, agent: str, came: bool) -> None:
        self._loop.call_soon_threadsafe(self._changed, agent, came)

    def _changed(self, agent: str, came: bool) -> None:
        if agent == "clock":
            self.feed.set_present(came)
            self.status = None
            self._look.set()
            where = f"the market {self.run} at {self.endpoint}"
            if came:
                logs.print_message(f"{where} is there")
            else:
                logs.print_message(f"{where} is away; waiting for it", "warning")

    async def known_status(self) -> Status:
        """How the clock stands; no older than the latest slot, unless that has just come."""
        self.check()
        status = self.status
        stale = status is None or (-1 if status.last is None else status.last.position) < self.feed.position
        if status is None or (stale and self._loop.time() > self._status_at + FRESH_S):
            await self.refresh()
        if self.status is None:
            raise Problem("market-away", f"run {self.run}: its clock at {self.endpoint} does not answer")
        return self.status

    async def homes_status(self) -> Status:
        """The same with all homes; at most half a second old, and asked for once however many clients ask."""
        self.check()
        async with self._homes_lock:
            if self._homes is None or self._loop.time() > self._homes_until:
                self._homes = await self.ask(lambda client: client.control("status"))
                self._homes_until = self._loop.time() + HOMES_PERIOD_S
            return self._homes

    def forget_homes(self) -> None:
        """The homes have changed: ask again."""
        self._homes = None

    async def control(self, command: Command, *, slots: int = 1, speed: float | None = None) -> Status:
        """Steer the market; how it stands then is known at once."""
        status = await self.ask(lambda client: client.control(command, slots=slots, speed=speed, homes=False))
        self.status = status
        return status

    async def refresh(self) -> None:
        """Ask the clock how it stands, and remember it."""
        asked_at = self._loop.time()
        async with self._status_lock:
            if self._status_at >= asked_at:
                return  # somebody else has asked in the meantime
            before = self.feed.latest
            try:
                self.status = await self.ask(lambda client: client.control("status", homes=False))
            except (ZengridError, Problem):
                self.status = None
            else:
                if self.status.last is None and self.feed.latest is before:
                    self.feed.clear()  # a new market has begun where an old one was
            self._status_at = asked_at


async def _link(connection: HTTPConnection) -> MarketLink:
    link: MarketLink = connection.app.state.link
    return link


Link = Annotated[MarketLink, Depends(_link)]
"""The link to the market, for routes."""
