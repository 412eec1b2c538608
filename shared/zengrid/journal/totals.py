"""Sums over all settled slots of a run, beside its baseline without demand response; the journal keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.slot_columns import FLOAT
from zengrid.journal.slot_record import SlotRecord

Floats = NDArray[np.float64]

MARKET_TOTALS = (
    "profit", "baseline_profit", "bills", "baseline_bills", "reserve_kwh", "baseline_reserve_kwh",
    "curtailed_kwh", "unserved_kwh",
)  # fmt: skip
"""Names of the market's sums. [$], [kWh]"""
HOME_TOTALS = ("bill", "baseline_bill", "fallback")
"""Columns whose sum is kept for each home: bills [$], and slots in which the fallback acted."""
_COUNTED = (
    "profit", "baseline_profit", "facility_kw", "baseline_facility_kw", "curtailed_kw", "home_curtailed_kw",
    "unserved_kw", "home_unserved_kw", "grid_fallback", *HOME_TOTALS,
)  # fmt: skip
"""Columns of a slot that are added up."""


QUEUED_SLOTS, QUEUED_VALUES = 64, 10_000
"""Slots, or values of one column, that wait to be added up at once: one by one, each would cost as much as all."""


class RunTotals:
    """Sums over all settled slots: of the market, and of each home that ever took part.

    A home that leaves keeps its sums and, if it comes back under the same id, continues them. Pruned slots stay counted
    because ``prune`` writes the sums before it deletes slots. A clock that resumes reads the sums, not the slots.

    Parameters
    ----------
    dt_h:
        Length of a slot. [h]
    """

    def __init__(self, dt_h: float) -> None:
        self.slots = 0
        """Slots counted."""
        self._grid_fallbacks = 0
        self._market: Floats = np.zeros(len(MARKET_TOTALS))
        self._homes: Floats = np.zeros((len(HOME_TOTALS), 0))
        """(total, home)"""
        self._index: dict[str, int] = {}
        """Position of each home in it, in order of their first slot."""
        self._present: tuple[str, ...] = ()
        """Homes of the slots in the queue."""
        self._at: slice | NDArray[np.intp] = slice(0)
        """Their positions."""
        self._dt_h = dt_h
        self._queue: list[SlotRecord] = []
        """Slots that are not in the sums yet."""

    @property
    def homes(self) -> tuple[str, ...]:
        """All homes that ever took part, in order of their first slot."""
        return tuple(self._index)

    @property
    def grid_fallbacks(self) -> int:
        """Slots in which the grid agent's fallback acted."""
        self._add_queue()
        return self._grid_fallbacks

    def market(self) -> dict[str, float]:
        """The market's sums by the names in ``MARKET_TOTALS``. [$], [kWh]"""
        self._add_queue()
        return dict(zip(MARKET_TOTALS, self._market.tolist(), strict=True))

    def of_homes(self, homes: tuple[str, ...]) -> dict[str, Floats]:
        """Sums of some homes by the names in ``HOME_TOTALS``, ``(home,)`` each; 0 for a home without a slot."""
        self._add_queue()
        if homes is self._present or homes == self._present:
            sums = self._homes[:, self._at].copy()
        else:
            # The last entry stands for homes without a slot.
            places = np.array([self._index.get(home, -1) for home in homes], np.intp)
            sums = np.pad(self._homes, ((0, 0), (0, 1)))[:, places]
        return dict(zip(HOME_TOTALS, sums, strict=True))

    def add(self, record: SlotRecord, homes: tuple[str, ...]) -> None:
        """Count one slot.

        Parameters
        ----------
        homes:
            Ids of the homes, in the order of the record's arrays.
        """
        if homes is not self._present:
            self._switch_to(homes)
        self.slots += 1
        self._queue.append(record)
        if len(self._queue) >= QUEUED_SLOTS or len(self._queue) * len(homes) >= QUEUED_VALUES:
            self._add_queue()

    def add_block(self, block: Block) -> None:
        """Count the slots of a block of the journal."""
        self._switch_to(block.roster.homes)
        self.slots += len(block)
        self._add(block.columns)

    def _switch_to(self, homes: tuple[str, ...]) -> None:
        """Add what follows to these homes."""
        self._add_queue()
        if homes != self._present:
            for home in homes:
                self._index.setdefault(home, len(self._index))
            self._homes = np.pad(self._homes, ((0, 0), (0, len(self._index) - self._homes.shape[1])))
            places = [self._index[home] for home in homes]
            prefix = places == list(range(len(places)))
            self._at = slice(len(places)) if prefix else np.array(places, np.intp)
        self._present = homes

    def _add_queue(self) -> None:
        queue, self._queue = self._queue, []
        if queue:
            self._add({name: np.array([getattr(record, name) for record in queue]) for name in _COUNTED})

    def _add(self, columns: Mapping[str, NDArray[Any]]) -> None:
        dt_h = self._dt_h
        for sums, name in zip(self._homes, HOME_TOTALS, strict=True):
            sums[self._at] += np.add.reduce(columns[name], dtype=np.float64)
        added = (
            columns["profit"], columns["baseline_profit"], columns["bill"], columns["baseline_bill"],
            columns["facility_kw"][:, 1:] * dt_h, columns["baseline_facility_kw"][:, 1:] * dt_h,
            (columns["curtailed_kw"] + columns["home_curtailed_kw"]) * dt_h,
            (columns["unserved_kw"] + columns["home_unserved_kw"]) * dt_h,
        )  # fmt: skip
        self._market = self._market + [float(np.sum(column)) for column in added]
        self._grid_fallbacks += int(np.sum(columns["grid_fallback"]))

    def encode(self) -> bytes:
        """Write as the journal keeps it: float64 numbers, then the homes' ids, one a line."""
        self._add_queue()
        head = (self.slots, self._grid_fallbacks, len(self._index))
        numbers = np.concatenate([np.array(head, FLOAT), self._market, self._homes.ravel()]).astype(FLOAT)
        return numbers.tobytes() + "\n".join(self._index).encode()

    @classmethod
    def decode(cls, data: bytes, dt_h: float) -> Self:
        """Read what ``encode`` wrote.

        Raises
        ------
        JournalError
            The data is of another length than it says.
        """
        made = cls(dt_h)
        try:
            slots, grid_fallbacks, count = (int(number) for number in np.frombuffer(data, FLOAT, 3))
            market, homes = np.split(
                np.frombuffer(data, FLOAT, len(MARKET_TOTALS) + len(HOME_TOTALS) * count, 3 * FLOAT.itemsize),
                [len(MARKET_TOTALS)],
            )
            names = data[(3 + market.size + homes.size) * FLOAT.itemsize :].decode().split("\n") if count else []
            made._index = {name: place for place, name in enumerate(names)}
            if len(made._index) != count:
                raise ValueError(f"{len(made._index)} ids for {count} homes")
        except (ValueError, OverflowError) as error:
            raise JournalError(f"the journal is damaged: its totals cannot be read ({error})") from error
        made.slots, made._grid_fallbacks = slots, grid_fallbacks
        made._market, made._homes = market.copy(), homes.reshape(len(HOME_TOTALS), count).copy()
        return made
