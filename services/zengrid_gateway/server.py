"""The HTTP server: one process, one event loop, listening where it was told, ending at once when asked to."""

from __future__ import annotations

import contextlib
import signal
import socket
from collections.abc import Iterator

import uvicorn
from fastapi import FastAPI

from zengrid import logs
from zengrid.errors import BusError
from zengrid_gateway.link import MarketLink
from zengrid_gateway.log import log_config
from zengrid_gateway.protocol import BoundedProtocol
from zengrid_gateway.settings import Settings

BACKLOG = 2048
CONNECTIONS = 4096
"""Most connections at a time; more are told to come back later."""


class Server(uvicorn.Server):
    """Ends live streams when it is asked to stop, instead of waiting for them, and ends without an error."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop at SIGTERM and Ctrl-C."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self.handle_exit)
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let live streams end, then everything else."""
        app = self.config.app
        assert isinstance(app, FastAPI)
        link: MarketLink = app.state.link
        link.feed.end()
        await super().shutdown(sockets)


def listen(settings: Settings) -> socket.socket:
    """The socket to serve on.

    Raises
    ------
    BusError
        Where the address cannot be listened on.
    """
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family, backlog=BACKLOG)
    except (OSError, OverflowError) as error:
        raise BusError(f"--host {settings.host} --port {settings.port}: cannot listen there: {error}") from None


def serve(app: FastAPI, settings: Settings) -> None:
    """Serve until a signal asks to stop."""
    with listen(settings) as listener:
        host, port = listener.getsockname()[:2]
        logs.print_message(f"run {settings.run} at http://{f'[{host}]' if ':' in host else host}:{port}")
        config = uvicorn.Config(
            app,
            loop="uvloop",
            http=BoundedProtocol,
            ws="websockets-sansio",
            lifespan="on",
            log_level="warning",
            log_config=log_config(),
            access_log=False,
            server_header=False,
            proxy_headers=False,
            limit_concurrency=CONNECTIONS,
            timeout_graceful_shutdown=2,
            ws_max_size=4096,
            ws_max_queue=4,
            ws_per_message_deflate=False,
        )
        Server(config).run([listener])
