"""Who may read, and who may steer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.requests import HTTPConnection

from zengrid import logs
from zengrid_gateway.invalid import short
from zengrid_gateway.problems import Problem
from zengrid_gateway.tokens import Role, Tokens

Protect = Literal["nothing", "writing", "everything"]
_bearer = HTTPBearer(
    auto_error=False, description="A token of the gateway; needed unless it listens on loopback alone."
)


@dataclass(frozen=True, slots=True)
class Access:
    """The rules of one gateway."""

    protect: Protect
    tokens: Tokens

    def check(self, connection: HTTPConnection, role: Role) -> None:
        """Raise a Problem where a request may not do what it asks for."""
        if role == "operate" or connection.scope["type"] == "websocket":
            check_origin(connection)
        if self.protect == "nothing" or (self.protect == "writing" and role == "read"):
            return
        token = bearer(connection)
        if token is None:
            raise Problem(
                "unauthorized", f"Authorization: missing; needed: Bearer TOKEN with the role {role}", headers=_ASK
            )
        known = self.tokens.role(token)
        if known is None:
            raise Problem("unauthorized", "Authorization: this token is not known here", headers=_ASK)
        if role == "operate" and known != "operate":
            raise Problem("forbidden", "role = read: this needs a token with the role operate")


_ASK = {"www-authenticate": 'Bearer realm="zengrid"'}


def open_access(protect: Protect, path: Path) -> Access:
    """The rules, with the tokens where any are needed; new ones are shown, this one time."""
    if protect == "nothing":
        return Access(protect, Tokens({}))
    tokens, made = Tokens.load(path)
    for role, token in made.items():
        logs.print_message(f"token to {role}, shown this one time: {token}")
    return Access(protect, tokens)


def check_origin(connection: HTTPConnection) -> None:
    """Refuse what a page of another site asks a browser to do here."""
    origin = connection.headers.get("origin")
    if origin is not None and origin.partition("://")[2] != connection.headers.get("host"):
        allowed = getattr(connection.app.state, "origins", ())
        if origin not in allowed:
            raise Problem(
                "forbidden", f"Origin = {short(origin)}: pages of other sites may not steer the market (see --cors)"
            )


def bearer(connection: HTTPConnection) -> str | None:
    """The token of a request, if it has one."""
    scheme, _, token = connection.headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


def _needs(role: Role) -> Any:
    async def check(request: Request, _: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)]) -> None:
        access: Access = request.app.state.access
        access.check(request, role)

    return Depends(check)


READ = _needs("read")
"""Dependency of routes that only tell."""
OPERATE = _needs("operate")
"""Dependency of routes that change the market."""
