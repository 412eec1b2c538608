"""Bodies of requests: counted before they are parsed, so that none keeps the gateway busy."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from fastapi.routing import APIRoute
from pydantic_core import from_json
from starlette.requests import Request
from starlette.responses import Response

from zengrid_gateway.invalid import FieldError, short
from zengrid_gateway.problems import Problem

MAX_BYTES = 2 * 2**20
"""Largest body."""
MAX_FIELDS = 1000
"""Most fields of all objects in a body together: each can be invalid, and pydantic reports every one."""
MAX_VALUES = 200_000
"""Most numbers, strings, lists and objects in a body."""


class BodyRoute(APIRoute):
    """A route whose body is counted before it is parsed; the class of every route with a body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """FastAPI's handler, for a request that counts its body first."""
        handle = super().get_route_handler()

        async def handle_counted(request: Request) -> Response:
            return await handle(_Request(request.scope, request.receive))

        return handle_counted


class _Request(Request):
    async def json(self) -> Any:
        return parse(await self.body())


def parse(body: bytes) -> Any:
    """Parse JSON of at most 200 levels.

    Counts the punctuation first, in strings too, so the counts are never too low.

    Raises
    ------
    Problem
        The body has too many fields or values, or is not JSON.
    """
    fields = body.count(b":")
    values = 1 + body.count(b",") + body.count(b"[") + body.count(b"{")
    for name, count, most in (("fields", fields, MAX_FIELDS), ("values", values, MAX_VALUES)):
        if count > most:
            raise Problem("too-large", f"body = {count} {name}: {most} at most")
    try:
        return from_json(body, allow_inf_nan=False)
    except ValueError as error:
        start = short(body[:1000].decode(errors="replace"))
        wrong = FieldError(field="body", value=start, allowed=f"JSON in UTF-8, 200 levels at most; {error}")
        raise Problem("invalid", f"body = {start}: {wrong.allowed}", errors=[wrong]) from None
