"""Many slots at once, column by column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from zengrid.journal.roster import Roster


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive slots under one roster: figures ``(slot,)``, arrays ``(slot, facility)`` and ``(slot, home)``."""

    roster: Roster
    columns: dict[str, NDArray[Any]]

    def __getitem__(self, column: str) -> NDArray[Any]:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.columns["position"])
