"""Whose the arrays of homes are."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from zengrid.errors import JournalError


@dataclass(frozen=True, slots=True)
class RosterRecord:
    """Who the arrays belong to. A new version counts from the slot it is committed with.

    Parameters
    ----------
    version:
        Grows with every change.
    homes:
        Ids of the homes, in the order of the arrays.
    specs:
        Each home as its scenario describes it, in the same order; anything JSON can hold.
    agents:
        ``(id, its homes, instance of the process that speaks for it or None)``.
    """

    version: int
    homes: tuple[str, ...]
    specs: tuple[Mapping[str, Any], ...]
    agents: tuple[tuple[str, tuple[str, ...], str | None], ...]

    def encode(self) -> bytes:
        """As the journal stores it: compressed JSON, since 10,000 homes differ in little."""
        body = {"homes": self.homes, "specs": self.specs, "agents": self.agents}
        return zlib.compress(json.dumps(body, separators=(",", ":")).encode(), level=1)

    @classmethod
    def decode(cls, version: int, data: bytes) -> Self:
        """The inverse of ``encode``."""
        try:
            body = json.loads(zlib.decompress(data))
            agents = tuple((name, tuple(homes), instance) for name, homes, instance in body["agents"])
            return cls(version, tuple(body["homes"]), tuple(body["specs"]), agents)
        except (zlib.error, ValueError, KeyError, TypeError, RecursionError) as error:
            raise JournalError(f"the journal is damaged: roster version {version} cannot be read ({error})") from error
