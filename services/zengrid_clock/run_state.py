"""Where a run stands: the next slot, the price in force, and the sums of all slots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from zengrid.journal import RunTotals

if TYPE_CHECKING:
    from zengrid.journal import SlotRecord


@dataclass(slots=True)
class RunState:
    """The position of a run. It changes when a slot begins, is played, or is written to the journal."""

    slots_per_day: int
    buy_price: float
    """In force: the price of the last slot, until the grid agent sets the next one. [$/kWh]"""
    totals: RunTotals
    day: int = 0
    slot: int = 0
    """Day and slot that are being played, or come next."""
    is_playing: bool = False
    position: int = 0
    """Number of slots in the journal."""
    last_record: SlotRecord | None = None
    """The last slot in the journal."""

    def following(self) -> tuple[int, int]:
        """The day and slot after the present one."""
        later = self.slot + 1
        return (self.day, later) if later < self.slots_per_day else (self.day + 1, 0)

    def next_to_begin(self) -> tuple[int, int]:
        """The first day and slot that have not begun: changes to the market take effect there."""
        return self.following() if self.is_playing else (self.day, self.slot)

    def slot_played(self) -> None:
        """The present slot is settled: move on to the next."""
        self.day, self.slot = self.following()
        self.is_playing = False

    def slot_journalled(self, record: SlotRecord, homes: tuple[str, ...]) -> None:
        """The journal has taken a slot."""
        self.position += 1
        self.last_record = record
        self.totals.add(record, homes)
