"""The web page: files known by name when the gateway starts; no name in a request reaches the file system."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

MEDIA_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}


def routes() -> list[Route]:
    """One route for each file of ``static/``, served from memory; and Plotly's script, from its own package."""
    own = [
        _route("/" if file.name == "index.html" else f"/{file.name}", file.read_bytes())
        for file in files("zengrid_gateway").joinpath("static").iterdir()
    ]
    return [*own, _plotly()]


def _route(path: str, body: bytes) -> Route:
    suffix = "html" if path == "/" else path.rpartition(".")[2]
    headers = _headers(hashlib.sha256(body).hexdigest()[:16])

    async def answer(request: Request) -> Response:
        if request.headers.get("if-none-match") == headers["etag"]:
            return Response(status_code=304, headers=headers)
        return Response(body, headers=headers, media_type=MEDIA_TYPES[suffix])

    return Route(path, answer, methods=["GET"])


def _plotly() -> Route:
    """5 MB: compressed once, when first asked for."""
    spec = find_spec("plotly")
    assert spec is not None
    assert spec.origin is not None
    path = Path(spec.origin).parent / "package_data" / "plotly.min.js"
    headers = {**_headers(f"plotly-{version('plotly')}"), "vary": "accept-encoding"}
    packed: list[bytes] = []
    packing = asyncio.Lock()

    async def answer(request: Request) -> Response:
        if request.headers.get("if-none-match") == headers["etag"]:
            return Response(status_code=304, headers=headers)
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(await asyncio.to_thread(path.read_bytes), headers=headers, media_type=MEDIA_TYPES["js"])
        async with packing:
            if not packed:
                packed.append(await asyncio.to_thread(lambda: gzip.compress(path.read_bytes(), 6)))
        return Response(packed[0], headers={**headers, "content-encoding": "gzip"}, media_type=MEDIA_TYPES["js"])

    return Route("/plotly.min.js", answer, methods=["GET"])


def _headers(tag: str) -> dict[str, str]:
    # The browser keeps the files, and asks each time whether they are still good: an upgrade shows at once.
    return {"etag": f'"{tag}"', "cache-control": "no-cache"}
