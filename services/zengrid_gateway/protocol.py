"""HTTP/1.1 with limits on what precedes a body: uvicorn takes URLs and headers of any length."""

from __future__ import annotations

from typing import NoReturn

from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol, RequestResponseCycle

from zengrid_gateway.guard import HEADERS
from zengrid_gateway.problems import Problem

MAX_URL_BYTES = 8 * 2**10
"""Longest path and query together."""
MAX_HEADERS = 100
"""Most headers of a request."""
MAX_HEADERS_BYTES = 32 * 2**10
"""Longest names and values of all headers together."""
MAX_PIPELINED = 100
"""Most requests on one connection that wait for the answer to an earlier one."""
LINGER_S = 2.0
"""How long the gateway discards what a refused client still sends, before it closes the connection. [s]"""


class BoundedProtocol(HttpToolsProtocol):
    """Refuses a request as soon as its URL or its headers are too long, and reads nothing after it."""

    _problem: Problem | None = None
    _refused = False
    _headers_bytes = 0
    _unparsed_bytes = 0
    """Received since the parser last called back: it buffers a header until that is complete."""

    def data_received(self, data: bytes) -> None:
        """Parse what was received."""
        if self._refused:
            return
        self._unparsed_bytes += len(data)
        super().data_received(data)
        if self._unparsed_bytes > MAX_HEADERS_BYTES and not self._refused:
            self._problem = _headers_too_large(f"{MAX_HEADERS_BYTES} bytes")
            self.send_400_response("")

    def on_message_begin(self) -> None:
        """A request begins."""
        self._headers_bytes = self._unparsed_bytes = 0
        super().on_message_begin()
        if len(self.pipeline) >= MAX_PIPELINED:
            self._refuse(Problem("too-many", f"requests without an answer: {MAX_PIPELINED} on one connection at most"))

    def on_url(self, url: bytes) -> None:
        """A part of the URL was parsed."""
        self._unparsed_bytes = 0
        super().on_url(url)
        if len(self.url) > MAX_URL_BYTES:
            start = self.url[:100].decode("latin-1")
            self._refuse(Problem("url-too-long", f"URL = {start}...: {MAX_URL_BYTES} bytes at most"))

    def on_header(self, name: bytes, value: bytes) -> None:
        """A header was parsed."""
        self._unparsed_bytes = 0
        self._headers_bytes += len(name) + len(value)
        if self._headers_bytes > MAX_HEADERS_BYTES:
            self._refuse(_headers_too_large(f"{MAX_HEADERS_BYTES} bytes"))
        if len(self.headers) == MAX_HEADERS:
            self._refuse(_headers_too_large(str(MAX_HEADERS)))
        super().on_header(name, value)

    def on_body(self, body: bytes) -> None:
        """A part of the body was received."""
        self._unparsed_bytes = 0
        super().on_body(body)

    def _refuse(self, problem: Problem) -> NoReturn:
        """Stop the parser, which calls ``send_400_response`` then."""
        self._problem = problem
        raise problem

    def send_400_response(self, msg: str) -> None:
        """Send the problem, and discard what the client still sends: only then does it read the answer."""
        self._refused = True
        self.loop.call_later(LINGER_S, self.transport.close)
        cycle: RequestResponseCycle | None = self.cycle
        if cycle is not None and not cycle.response_complete:
            cycle.keep_alive = False  # the request before this one is still being answered
            return
        app = self.config.app
        assert isinstance(app, FastAPI)
        response = (self._problem or Problem("malformed", "request: does not follow HTTP/1.1")).response()
        app.state.metrics.answered("other", response.status_code, 0.0)
        headers = [*response.raw_headers, *HEADERS, (b"connection", b"close")]
        lines = b"".join(b"%b: %b\r\n" % header for header in headers)
        self.transport.write(STATUS_LINE[response.status_code] + lines + b"\r\n" + bytes(response.body))
        self.transport.write_eof()


def _headers_too_large(allowed: str) -> Problem:
    return Problem("headers-too-large", f"headers: more than {allowed}; {allowed} at most")
