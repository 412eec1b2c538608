"""What every request passes: the name it was sent to, its rate, security headers, and the stop watch."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from zengrid import logs
from zengrid.bus.addresses import is_loopback
from zengrid.rate_limit import RateLimit
from zengrid_gateway import bodies
from zengrid_gateway.invalid import short
from zengrid_gateway.problems import Problem

# Plotly sets styles of elements; scripts come from here alone, and nothing is sent elsewhere.
POLICY = (
    b"default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    b"object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"content-security-policy", POLICY),
]
"""Of every answer."""
MAX_PARAMETERS = 100
"""Most parameters in a query."""
HOST = re.compile(r"(?:\[(?P<bracketed>[^\[\]]*)\]|(?P<name>[^:\[\]]*))(?::[0-9]*)?")
"""``[::1]:8080``, ``localhost:8080``, either without the port."""


class Guard:
    """ASGI middleware around the whole application.

    Parameters
    ----------
    local:
        Whether the gateway listens on loopback alone. Then only requests to a name of this machine are answered: a page
        of another site, whose name is made to lead here, sends its own.
    rate:
        How much one client may ask for.
    answered:
        Told each route, status and time [s].
    """

    def __init__(self, app: ASGIApp, local: bool, rate: RateLimit, answered: Callable[[str, int, float], None]) -> None:
        self._app = app
        self._local = local
        self._rate = rate
        self._answered = answered

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        began = time.perf_counter()
        if head := scope.get("method") == "HEAD":
            scope = {**scope, "method": "GET"}  # the answer is that of GET, without what follows its head

        async def send_on(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS]
                route = getattr(scope.get("route"), "path", "other")
                self._answered(route, message["status"], time.perf_counter() - began)
                if message["status"] >= HTTPStatus.BAD_REQUEST and logs.is_enabled("info"):
                    request = {"method": scope["method"], "path": scope["path"][:200]}
                    logs.log_event("info", "request failed", **request, status=message["status"])
                await send(message)
                if head:
                    await send({"type": "http.response.body"})
            elif not head:
                await send(message)

        problem = self._refuse(scope)
        if problem is None:
            await self._app(scope, receive, send_on)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008, "reason": problem.detail[:120]})
        else:
            await problem.response()(scope, receive, send_on)

    def _refuse(self, scope: Scope) -> Problem | None:
        headers = dict(scope["headers"])
        if self._local:
            hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
            for host in hosts:
                if not _is_local(host):
                    allowed = "localhost, 127.0.0.1 or [::1]"
                    detail = f"Host = {short(host)}: this gateway answers to {allowed} alone (see --host)"
                    return Problem("misdirected", detail)
        length = int(headers.get(b"content-length", b"0"))
        if length > bodies.MAX_BYTES:
            return Problem("too-large", f"body = {length} bytes: {bodies.MAX_BYTES} at most")
        if b"transfer-encoding" in headers:
            return Problem("length-required", "Content-Length: missing; a body must come with its length")
        parameters = scope["query_string"].count(b"&") + 1
        if parameters > MAX_PARAMETERS:
            return Problem("url-too-long", f"query = {parameters} parameters: {MAX_PARAMETERS} at most")
        wait_s = self._rate.wait_s(scope["client"][0] if scope["client"] else "", time.monotonic())
        if wait_s:
            seconds = f"{wait_s:.0f}" if wait_s > 1 else "1"
            text = f"requests: more than {self._rate.per_s:g} a second; go on in {seconds} s"
            return Problem("too-many", text, headers={"retry-after": seconds})
        return None


def _is_local(host: str) -> bool:
    """Whether a Host header names this machine; a client of HTTP/1.0 may leave it empty."""
    match = HOST.fullmatch(host)
    return not host or (match is not None and is_loopback((match["bracketed"] or match["name"] or "").lower()))
