"""The market without demand response, settled many slots at a time: it depends on no agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.home_physics import battery_step
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous
from zengrid.journal.slot_record import BaselineSlot

if TYPE_CHECKING:
    from zengrid.core.params import MarketParams

Floats = NDArray[np.float64]

VALUES = 10_000
"""Slots settled at a time: so many values of one column, and no more slots than there are profiles."""
NOTHING = BaselineSlot(*np.zeros((4, 0, 0)))


class BaselineAhead:
    """Settles the baseline ahead of the market.

    Parameters
    ----------
    buy_price:
        The constant price of the baseline. [$/kWh]
    soc_reset:
        Whether batteries begin each day as the first, or carry their energy over.
    """

    def __init__(self, slots_per_day: int, buy_price: float, soc_reset: Literal["daily", "never"]) -> None:
        self._slots_per_day = slots_per_day
        self._buy_price = buy_price
        self._soc_reset = soc_reset
        self._settled = NOTHING
        self._first = 0, 0
        """The first day and slot that were settled."""

    def reset(self) -> None:
        """Settle anew: the homes have changed."""
        self._settled = NOTHING

    def slot(
        self, day: int, slot: int, profiles: Callable[[], Exogenous], soc: Floats, params: MarketParams
    ) -> BaselineSlot:
        """The baseline of one slot.

        Parameters
        ----------
        profiles:
            Gives the profiles from this day on, ``(day, slot, ...)``, as many days as are there.
        soc:
            State of charge in the baseline at the start of the slot, ``(home,)``. [-]
        """
        days, within = day - self._first[0], slot - self._first[1]
        if not (0 <= days < self._settled.soc.shape[0] and 0 <= within < self._settled.soc.shape[1]):
            self._settled = self._settle(slot, profiles(), soc, params)
            self._first = day, slot
            days = within = 0
        return BaselineSlot(*(column[days, within] for column in self._settled))

    def _settle(self, slot: int, profiles: Exogenous, start: Floats, params: MarketParams) -> BaselineSlot:
        """Settle from this slot on, ``(day, slot, ...)``: many slots cost little more than one."""
        slots = min(self._slots_per_day - slot, max(VALUES // max(params.homes.count, 1), 1))
        days = max(VALUES // profiles.pv_kw[0].size, 1) if slot == 0 else 1
        ahead = profiles.part((slice(0, days), slice(slot, slot + slots)))
        command = conventional(ahead.pv_kw, ahead.load_kw, params.homes)
        soc = self._charge(command, start, params)
        price = np.full(command.shape[:2], self._buy_price)
        settled = settle(soc, Action(price, command), ahead, params)
        return BaselineSlot(settled.soc, settled.bill, settled.profit, settled.facility_kw)

    def _charge(self, command: Floats, start: Floats, params: MarketParams) -> Floats:
        """State of charge at the start of each slot, ``(day, slot, home)``. [-]"""
        soc = np.empty_like(command)
        start = np.broadcast_to(start, command[:, 0].shape)
        # Each round has one day more right, so that after as many rounds as days all of them are.
        for _ in range(len(command)):
            state = start
            for slot in range(command.shape[1]):
                soc[:, slot] = state
                _, state = battery_step(state, command[:, slot], params)
            # If energy is carried over, a day starts as the one before it ended. A battery that is full or empty once
            # a day forgets how it started, which ends this sooner.
            carried = start if self._soc_reset == "daily" else np.concatenate([start[:1], state[:-1]])
            if np.array_equal(carried, start):
                break
            start = carried
        return soc
