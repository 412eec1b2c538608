"""The application: routes, errors, and the link that lives as long as it does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI

from zengrid import __version__
from zengrid_gateway import health, history, live, market, page, price, problems
from zengrid_gateway.archive import Archive
from zengrid_gateway.frames import Frames
from zengrid_gateway.link import MarketLink
from zengrid_gateway.settings import Settings


def create_app(settings: Settings) -> FastAPI:
    """An application that shows one market."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with MarketLink(settings.run, settings.endpoint) as link:
            app.state.link = link
            app.state.board = price.PriceBoard(link)
            app.state.frames = Frames(link.feed)
            writing = asyncio.create_task(app.state.frames.run())
            app.state.archive = Archive(link, settings.journal)
            yield
            link.feed.end()
            await writing
            app.state.archive.close()

    app = FastAPI(title="zengrid", version=__version__, lifespan=lifespan, docs_url=None, redoc_url=None)
    problems.install(app)
    for subject in (price, market, live, history, health):
        app.include_router(subject.router)
    app.router.routes.extend(page.routes())
    return app
