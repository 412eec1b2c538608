"""The web page: files known by name when the gateway starts; no name in a request reaches the file system."""

from __future__ import annotations

import hashlib
from importlib.resources import files

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

MEDIA_TYPES = {
    "html": "text/html",
    "css": "text/css",
    "js": "text/javascript",
    "svg": "image/svg+xml",
    "webmanifest": "application/manifest+json",
}


def routes() -> list[Route]:
    """One route for each file of ``static/``, served from memory."""
    return [
        _route("/" if file.name == "index.html" else f"/{file.name}", file.read_bytes())
        for file in files("zengrid_gateway").joinpath("static").iterdir()
    ]


def _route(path: str, body: bytes) -> Route:
    suffix = "html" if path == "/" else path.rpartition(".")[2]
    tag = f'"{hashlib.sha256(body).hexdigest()[:16]}"'
    # The browser keeps the files, and asks each time whether they are still good: an upgrade shows at once.
    headers = {"etag": tag, "cache-control": "no-cache"}

    async def answer(request: Request) -> Response:
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers=headers)
        return Response(body, headers=headers, media_type=MEDIA_TYPES[suffix])

    return Route(path, answer, methods=["GET"])
