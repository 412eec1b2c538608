"""The application: routes by subject, errors, access, and the link that lives as long as it does."""

from __future__ import annotations

import asyncio
import functools
import gc
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware

from zengrid import __version__
from zengrid.rate_limit import RateLimit
from zengrid_gateway import (
    control,
    health,
    history,
    live,
    market,
    metrics,
    page,
    policies,
    price,
    problems,
    prosumers,
    runs,
    scenario,
    spawners,
)
from zengrid_gateway.access import READ, Access
from zengrid_gateway.archive import Archive
from zengrid_gateway.document import describe
from zengrid_gateway.frames import Frames
from zengrid_gateway.guard import Guard
from zengrid_gateway.link import MarketLink
from zengrid_gateway.settings import Settings
from zengrid_gateway.shelf import Shelf

WORKERS = 4
"""Threads for slow work, such as reading the journal."""


def create_app(settings: Settings, access: Access) -> FastAPI:
    """An application that shows one market."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        # Few threads for slow work, so that the event loop gets its turn soon.
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(WORKERS, "worker"))
        app.openapi()  # takes 0.3 s, for which no request should wait
        gc.freeze()  # a full collection takes 60 ms otherwise
        state = app.state
        async with MarketLink(settings.run, settings.endpoint, settings.certs) as state.link:
            state.frames = Frames(state.link.feed)
            state.board = price.PriceBoard(state.link)
            state.archive = Archive(state.link, settings.journal)
            state.book = runs.Book()
            state.shelf = Shelf(settings.policies)
            state.metrics = metrics.Metrics(state.link, state.frames)
            writing = asyncio.create_task(state.frames.run())
            yield
            state.link.feed.end()
            await writing
            state.archive.close()

    app = FastAPI(
        title="zengrid",
        version=__version__,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    app.openapi = functools.cache(lambda: describe(app))  # type: ignore[method-assign] # FastAPI's own way to change it
    app.state.access = access
    app.state.origins = settings.origins
    problems.install(app)
    app.include_router(health.router)
    for subject in (price, market, scenario, live, prosumers, spawners, policies, history, runs, control, metrics):
        app.include_router(subject.router, dependencies=[READ])
    app.include_router(live.socket_router)
    app.router.routes.extend(page.routes())
    app.add_middleware(price.PriceFirst)
    if settings.origins:
        app.add_middleware(CORSMiddleware, allow_origins=settings.origins, allow_methods=["*"], allow_headers=["*"])
    app.add_middleware(
        Guard,
        local=settings.local,
        rate=RateLimit(settings.rate_per_s),
        answered=lambda *answer: app.state.metrics.answered(*answer),
    )
    return app
