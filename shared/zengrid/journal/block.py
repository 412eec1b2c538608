"""Consecutive slots of a run, column by column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from zengrid.journal.roster_record import RosterRecord


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive slots under one roster: figures ``(slot,)``, arrays ``(slot, facility)`` and ``(slot, home)``."""

    roster: RosterRecord
    columns: dict[str, NDArray[Any]]

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.columns["position"])
