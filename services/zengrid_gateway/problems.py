"""Errors as RFC 9457 problem details: one catalogue, used for the answers and for their documentation."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any, Literal

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException

from zengrid import logs
from zengrid.errors import BusError, JournalUnavailableError, RefusedError, ZengridError
from zengrid_gateway import invalid
from zengrid_gateway.invalid import EXPLAINED, FieldError, short

MEDIA_TYPE = "application/problem+json"
DETAIL = 2000
"""Longest detail. [characters]"""

Kind = Literal[
    "market-away", "agent-away", "journal-away", "no-slot", "no-spawner", "busy", "unauthorized", "forbidden",
    "not-found", "method-not-allowed", "refused", "length-required", "too-large", "misdirected", "invalid", "too-many",
    "malformed", "url-too-long", "headers-too-large", "failed",
]  # fmt: skip

CATALOGUE: Mapping[Kind, tuple[int, str, str]] = {
    "market-away": (
        503,
        "The market is away",
        "run main: nobody listens at tcp/127.0.0.1:7447; the gateway goes on trying",
    ),
    "agent-away": (503, "The agent is away", "agent = p1: has no process that could answer"),
    "journal-away": (503, "The journal is away", "journal zengrid.db cannot be read: unable to open database file"),
    "no-slot": (503, "No slot is settled yet", "run main: waits for its agents"),
    "no-spawner": (503, "Nobody can start prosumers", "run main: has no spawner; start one with: zengrid spawner"),
    "busy": (503, "Too many clients", "clients = 1000: 1000 may watch at a time; try again later"),
    "unauthorized": (401, "Who are you?", "Authorization: missing; needed: Bearer TOKEN with the role operate"),
    "forbidden": (403, "Not allowed", "role = read: this needs a token with the role operate"),
    "not-found": (404, "Not found", "/v1/prise: there is no such page"),
    "method-not-allowed": (405, "Method not allowed", "DELETE /v1/price: allowed are GET, HEAD"),
    "refused": (409, "The market refused", "the market is over"),
    "invalid": (422, "Invalid request", "limit = 0: Input should be greater than or equal to 1"),
    "length-required": (411, "Length required", "Content-Length: missing; a body must come with its length"),
    "too-large": (413, "Too large", "body: more than 2 MiB"),
    "misdirected": (421, "Not this server", "Host = example.org: this gateway answers to localhost alone"),
    "malformed": (400, "Malformed request", "request: does not follow HTTP/1.1"),
    "url-too-long": (414, "URL too long", "URL = /v1/history?since=0&since=0...: 8192 bytes at most"),
    "headers-too-large": (431, "Headers too large", "headers: more than 100; 100 at most"),
    "too-many": (429, "Too many requests", "requests: more than 100 a second; go on in 1 s"),
    "failed": (500, "The gateway failed", "an error that is not yours; the gateway's log has it"),
}
"""Each kind of problem: status code, title, and an example of its detail."""


REFUSALS: Mapping[str, Kind] = {"invalid": "invalid", "unknown": "not-found", "unavailable": "market-away"}
"""What the other side's reasons mean here; all others are conflicts."""
ANYWHERE: tuple[Kind, ...] = (
    "malformed", "url-too-long", "headers-too-large", "unauthorized", "misdirected", "too-many", "failed",
)  # fmt: skip
"""Problems that any request can meet."""


class ProblemDetails(BaseModel):
    """An error, as RFC 9457 describes it."""

    model_config = ConfigDict(title="Problem")

    type: str = Field(description="Kind of problem, as a URN.", examples=["urn:zengrid:invalid"])
    title: str
    status: int
    detail: str = Field(description="The thing, its value and what is permitted.")
    errors: list[FieldError] = Field(
        default_factory=list, description=f"Field by field, where a request was invalid: the first {EXPLAINED}."
    )
    more: int = Field(default=0, description="Invalid fields that `errors` does not list.")


class Problem(HTTPException):
    """Raised by a route to answer with a problem."""

    def __init__(
        self,
        kind: Kind,
        detail: str,
        *,
        errors: Sequence[FieldError] = (),
        more: int = 0,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        status, self.title, _ = CATALOGUE[kind]
        super().__init__(status, short(detail, DETAIL), headers)
        self.kind = kind
        self.errors = list(errors)
        self.more = more

    def response(self) -> Response:
        """As it is sent."""
        body = ProblemDetails(
            type=urn(self.kind),
            title=self.title,
            status=self.status_code,
            detail=logs.printable(self.detail),
            errors=self.errors,
            more=self.more,
        )
        headers = {"retry-after": "1"} if self.status_code == HTTPStatus.SERVICE_UNAVAILABLE else {}
        return Response(body.model_dump_json(), self.status_code, {**headers, **(self.headers or {})}, MEDIA_TYPE)


def urn(kind: Kind) -> str:
    """The ``type`` of a problem."""
    return f"urn:zengrid:{kind}"


def documented(*kinds: Kind) -> dict[int | str, dict[str, Any]]:
    """The problems a route may answer with, for its documentation; several kinds may share a status code."""
    responses: dict[int | str, dict[str, Any]] = {}
    for kind in (*kinds, *ANYWHERE):
        status, title, example = CATALOGUE[kind]
        body = {"type": urn(kind), "title": title, "status": status, "detail": example, "errors": [], "more": 0}
        media = {
            "schema": {"$ref": "#/components/schemas/Problem"},
            "examples": {kind: {"summary": title, "value": body}},
        }
        if status in responses:
            responses[status]["description"] += f"; or: {title}"
            responses[status]["content"][MEDIA_TYPE]["examples"] |= media["examples"]
        else:
            responses[status] = {"description": title, "content": {MEDIA_TYPE: media}}
    return responses


def install(app: FastAPI) -> None:
    """Answer every error of this application with a problem."""
    app.add_exception_handler(Problem, _problem)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ZengridError, _zengrid)
    app.add_exception_handler(Exception, _failed)


async def _problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, Problem)
    return error.response()


async def _invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    found = error.errors()
    if any(isinstance(each.get("input"), bytes) for each in found):
        media = request.headers.get("content-type", "missing")[:100]
        return Problem("invalid", f"Content-Type = {media}: a body must be application/json").response()

    def names(place: invalid.Place) -> list[str]:
        return invalid.fields(request.app.openapi(), request.scope["route"].path, request.method, place)

    errors, more = invalid.explain(found, error.body, names)
    first = errors[0]
    return Problem("invalid", f"{first.field} = {first.value}: {first.allowed}", errors=errors, more=more).response()


async def _http(request: Request, error: Exception) -> Response:
    """What the routing itself refuses."""
    assert isinstance(error, HTTPException)
    path = short(request.scope["path"])
    if error.status_code == HTTPStatus.NOT_FOUND:
        return Problem("not-found", f"{path}: there is no such page").response()
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        allowed = ", ".join(_methods(request)) or dict(error.headers or {}).get("Allow", "")
        detail = f"{request.method} {path}: allowed are {allowed}"
        return Problem("method-not-allowed", detail, headers={"allow": allowed}).response()
    return Problem("invalid", str(error.detail)).response()


def _methods(request: Request) -> list[str]:
    """What a path allows, of all routes that share it; the routing names those of the first alone."""
    methods: list[str] = []
    for template, operations in request.app.openapi()["paths"].items():
        if re.fullmatch(re.sub(r"{\w+}", "[^/]+", template), request.scope["path"]):
            methods += [method.upper() for method in operations]
    return sorted([*methods, "HEAD"] if "GET" in methods else methods)


async def _zengrid(request: Request, error: Exception) -> Response:
    if isinstance(error, BusError):
        return Problem("market-away", str(error)).response()
    if isinstance(error, JournalUnavailableError):
        return Problem("journal-away", str(error)).response()
    kind = REFUSALS.get(error.reason, "refused") if isinstance(error, RefusedError) else "invalid"
    inside = "body." if request.method == "POST" else ""
    return Problem(kind, str(error), errors=invalid.told(str(error), inside=inside)).response()


async def _failed(request: Request, error: Exception) -> Response:
    return Problem("failed", "an error that is not yours; the gateway's log has it").response()
