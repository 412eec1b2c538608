"""Bearer tokens: made once, shown once, kept as hashes."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from pathlib import Path
from typing import Literal, get_args

from pydantic_core import from_json

from zengrid.errors import ZengridError

Role = Literal["read", "operate"]
"""`operate` may do all that `read` may, and steer the market."""


class Tokens:
    """The tokens of one gateway, by their hash.

    A token is 256 random bits, which nobody can guess from its hash: a slow hash, as passwords need, would only give
    strangers a way to keep the gateway busy.
    """

    def __init__(self, roles: dict[str, Role]) -> None:
        self._roles = roles

    @classmethod
    def load(cls, path: Path) -> tuple[Tokens, dict[Role, str]]:
        """Read the tokens' file, or make it at the first start.

        Returns
        -------
        tuple[Tokens, dict[Role, str]]
            And the tokens that were made just now, to be shown once.

        Raises
        ------
        ZengridError
            The file cannot be read or made.
        """
        try:
            if path.exists():
                return cls._read(path), {}
            made: dict[Role, str] = {role: f"zengrid_{role}_{secrets.token_urlsafe(32)}" for role in get_args(Role)}
            tokens = cls({_hash(token): role for role, token in made.items()})
            tokens._write(path)
        except OSError as error:
            raise ZengridError(f"--tokens {path}: {error.strerror}") from None
        return tokens, made

    @classmethod
    def _read(cls, path: Path) -> Tokens:
        wrong = ZengridError(f'--tokens {path}: permitted is {{"sha256 of a token": "read" or "operate", ...}}')
        try:
            roles = from_json(path.read_bytes())
        except ValueError:
            raise wrong from None
        if not isinstance(roles, dict) or not all(role in get_args(Role) for role in roles.values()):
            raise wrong
        return cls(roles)

    def _write(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Made readable for its owner alone, rather than made so afterwards.
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            json.dump(self._roles, file, indent=1)
            file.write("\n")

    def role(self, token: str) -> Role | None:
        """What a token allows; None where it is none of ours. Looked up by its hash, so that time tells nothing."""
        return self._roles.get(_hash(token))


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
