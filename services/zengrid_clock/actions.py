"""Reads an agent's action and checks it: who sent it, for which phase, and whether it is permitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes
from zengrid.wire.codec import decode
from zengrid.wire.slots import FleetAction, GridAction
from zengrid_clock.barrier import Moment, Refused
from zengrid_clock.roster import Agent

Floats = NDArray[np.float64]

PRICE_TOLERANCE = 1e-9
POWER_TOLERANCE_KW = 1e-9
BYTES_BASE = 1024
BYTES_PER_HOME = 40
"""An action larger than this is refused unread."""


def read_price(
    agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, levels: tuple[float, ...]
) -> tuple[Moment, float]:
    """The grid agent's price, as one of the permitted levels; raises ``Refused`` or ``WireError``."""
    if len(payload) > BYTES_BASE:
        raise Refused("oversized")
    action = decode(GridAction, payload, encoding)
    moment = _identify(agent, action, run)
    if moment == now:
        for level in levels:
            if abs(action.buy_price - level) <= PRICE_TOLERANCE:
                return moment, level
        raise Refused("out_of_range", moment)
    return moment, action.buy_price


class CommandRange:
    """The commands that the batteries of one agent permit, ready for a quick check."""

    def __init__(self, homes: Homes, mine: slice) -> None:
        self.count: int = mine.stop - mine.start
        self.bytes_max = BYTES_BASE + BYTES_PER_HOME * self.count
        self._middle_kw = (homes.charge_max_kw[mine] - homes.discharge_max_kw[mine]) / 2
        self._half_kw = (homes.charge_max_kw[mine] + homes.discharge_max_kw[mine]) / 2 + POWER_TOLERANCE_KW

    def permits(self, battery_kw: Floats) -> bool:
        """Whether there is one command for each home, within its power limits."""
        if battery_kw.shape != self._half_kw.shape:
            return False
        near = np.abs(battery_kw - self._middle_kw) <= self._half_kw
        return int(np.count_nonzero(near)) == self.count


def read_commands(
    agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, permitted: CommandRange
) -> tuple[Moment, Floats]:
    """A prosumer agent's commands, one a home; raises ``Refused`` or ``WireError``."""
    if len(payload) > permitted.bytes_max:
        raise Refused("oversized")
    action = decode(FleetAction, payload, encoding)
    moment = _identify(agent, action, run)
    battery_kw = np.asarray(action.battery_kw)
    if moment == now and not permitted.permits(battery_kw):
        raise Refused("out_of_range", moment)
    return moment, battery_kw


def _identify(agent: Agent, action: GridAction | FleetAction, run: str) -> Moment:
    if action.run != run:
        raise Refused("wrong_run")
    if action.instance != agent.instance:
        raise Refused("foreign")
    return Moment(action.day, action.slot, action.phase)
