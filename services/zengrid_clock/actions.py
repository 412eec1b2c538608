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


def read_price(agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, levels: tuple[float, ...]) -> tuple[Moment, float]:
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


def read_commands(agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, homes: Homes, mine: slice) -> tuple[Moment, Floats]:
    """A prosumer agent's commands, one a home; raises ``Refused`` or ``WireError``."""
    count = mine.stop - mine.start
    if len(payload) > BYTES_BASE + BYTES_PER_HOME * count:
        raise Refused("oversized")
    action = decode(FleetAction, payload, encoding)
    moment = _identify(agent, action, run)
    if moment == now:
        command = action.battery_kw
        if command.shape != (count,):
            raise Refused("out_of_range", moment)
        too_high = command > homes.charge_max_kw[mine] + POWER_TOLERANCE_KW
        too_low = command < -homes.discharge_max_kw[mine] - POWER_TOLERANCE_KW
        if (too_high | too_low).any():
            raise Refused("out_of_range", moment)
    return moment, action.battery_kw


def _identify(agent: Agent, action: GridAction | FleetAction, run: str) -> Moment:
    if action.run != run:
        raise Refused("wrong_run")
    if action.instance != agent.instance:
        raise Refused("foreign")
    return Moment(action.day, action.slot, action.phase)
