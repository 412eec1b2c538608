"""Reads an agent's action and checks it: who sent it, for which phase, and whether it is permitted."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes
from zengrid.wire.codec import decode, read
from zengrid.wire.slots import FleetAction, GridAction
from zengrid_clock.barrier import Moment, Refused
from zengrid_clock.roster import Agent

Floats = NDArray[np.float64]
Answer = TypeVar("Answer", GridAction, FleetAction)

PRICE_TOLERANCE = 1e-9
POWER_TOLERANCE_KW = 1e-9
BYTES_BASE = 1024
BYTES_PER_HOME = 40
"""An action larger than this is refused unread."""
FEW = 8
"""So many commands are compared one by one sooner than as arrays."""


def read_price(
    agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, levels: tuple[float, ...]
) -> tuple[Moment, float]:
    """The grid agent's price, as one of the permitted levels; raises ``Refused`` or ``WireError``."""
    if len(payload) > BYTES_BASE:
        raise Refused("oversized")
    moment, action = _read(GridAction, agent, payload, encoding, run, now)
    if moment != now:
        return moment, action.buy_price
    for level in levels:
        if abs(action.buy_price - level) <= PRICE_TOLERANCE:
            return now, level
    raise Refused("out_of_range", now)


class CommandRange:
    """The commands that the batteries of one agent permit, ready for a quick check."""

    def __init__(self, homes: Homes, mine: slice) -> None:
        self.count: int = mine.stop - mine.start
        self.bytes_max = BYTES_BASE + BYTES_PER_HOME * self.count
        self._least_kw = -homes.discharge_max_kw[mine] - POWER_TOLERANCE_KW
        self._most_kw = homes.charge_max_kw[mine] + POWER_TOLERANCE_KW
        self._few = list(zip(self._least_kw.tolist(), self._most_kw.tolist(), strict=True))[:FEW]

    def permits(self, battery_kw: list[float] | Floats) -> bool:
        """Whether there is one command for each home, within its power limits."""
        if len(battery_kw) != self.count:
            return False
        if self.count <= FEW:
            return all(least <= kw <= most for kw, (least, most) in zip(battery_kw, self._few, strict=True))
        commands_kw = np.asarray(battery_kw)
        return bool(((commands_kw >= self._least_kw) & (commands_kw <= self._most_kw)).all())


def read_commands(
    agent: Agent, payload: bytes, encoding: str, run: str, now: Moment, permitted: CommandRange
) -> tuple[Moment, list[float] | Floats]:
    """A prosumer agent's commands, one a home; raises ``Refused`` or ``WireError``."""
    if len(payload) > permitted.bytes_max:
        raise Refused("oversized")
    moment, action = _read(FleetAction, agent, payload, encoding, run, now)
    if moment != now:
        return moment, action.battery_kw
    if not permitted.permits(action.battery_kw):
        raise Refused("out_of_range", now)
    return now, action.battery_kw


def _read(
    kind: type[Answer], agent: Agent, payload: bytes, encoding: str, run: str, now: Moment
) -> tuple[Moment, Answer]:
    """An action and what it is for; whatever does not say what is waited for is looked at closely."""
    action = read(kind, payload, encoding)
    if _awaited(action, agent, run, now):
        return now, action
    action = decode(kind, payload, encoding)
    return _identify(agent, action, run), action


def _awaited(action: GridAction | FleetAction, agent: Agent, run: str, now: Moment) -> bool:
    """Whether it says what is waited for: then its values need no further check than that they are permitted."""
    return (
        action.slot == now.slot
        and action.day == now.day
        and action.phase == now.phase
        and action.instance == agent.instance
        and action.run == run
    )


def _identify(agent: Agent, action: GridAction | FleetAction, run: str) -> Moment:
    if action.run != run:
        raise Refused("wrong_run")
    if action.instance != agent.instance:
        raise Refused("foreign")
    return Moment(action.day, action.slot, action.phase)
