"""The homes and agents that the arrays of a slot belong to."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from zengrid.errors import JournalError


@dataclass(frozen=True, slots=True)
class RosterRecord:
    """The homes and agents of the slots from one position on. A new version holds from the slot it is committed with.

    Parameters
    ----------
    version:
        Increases with every change.
    homes:
        Ids of the homes, in the order of the arrays.
    specs:
        Each home as its scenario describes it, in the same order, as JSON can hold it.
    agents:
        ``(id, its homes, instance of the process that acts for it or None)``.
    """

    version: int
    homes: tuple[str, ...]
    specs: tuple[Mapping[str, Any], ...]
    agents: tuple[tuple[str, tuple[str, ...], str | None], ...]

    def encode(self) -> bytes:
        """Write as the journal stores it: JSON, compressed because most homes differ little."""
        body = {"homes": self.homes, "specs": self.specs, "agents": self.agents}
        return zlib.compress(json.dumps(body, separators=(",", ":")).encode(), level=1)

    @classmethod
    def decode(cls, version: int, data: bytes) -> Self:
        """Read what ``encode`` wrote."""
        try:
            body = json.loads(zlib.decompress(data))
            agents = tuple((name, tuple(homes), instance) for name, homes, instance in body["agents"])
            return cls(version, tuple(body["homes"]), tuple(body["specs"]), agents)
        except (zlib.error, ValueError, KeyError, TypeError, RecursionError) as error:
            raise JournalError(f"the journal is damaged: roster version {version} cannot be read ({error})") from error
