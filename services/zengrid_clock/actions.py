"""Reads an agent's action and checks who sent it, for which phase, and whether the market permits it."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from zengrid.core.params import Homes
from zengrid.wire.codec import read, read_checked
from zengrid.wire.slot_structs import FleetActionStruct, GridActionStruct
from zengrid_clock.barrier import ActionRefused, SlotPhase

Floats = NDArray[np.float64]
AnyAction = TypeVar("AnyAction", GridActionStruct, FleetActionStruct)

PRICE_TOLERANCE = 1e-9
POWER_TOLERANCE_KW = 1e-9
BYTES_BASE = 1024
BYTES_PER_HOME = 40
"""Larger actions are refused unread. [byte]"""
FEW = 8
"""Up to this many commands it is faster to compare one by one than as arrays."""


def read_price(
    payload: bytes, encoding: str, run: str, instance: str | None, now: SlotPhase, levels: tuple[float, ...]
) -> tuple[SlotPhase, float]:
    """Read the grid agent's price.

    Parameters
    ----------
    instance:
        The process that plays the grid agent.
    levels:
        Permitted prices. [$/kWh]

    Returns
    -------
    The phase that the action is for, and the price: one of the levels if the phase is ``now``.

    Raises
    ------
    ActionRefused, WireError
    """
    if len(payload) > BYTES_BASE:
        raise ActionRefused("oversized")
    phase, action = _read(GridActionStruct, payload, encoding, run, instance, now)
    if phase != now:
        return phase, action.buy_price
    for level in levels:
        if abs(action.buy_price - level) <= PRICE_TOLERANCE:
            return now, level
    raise ActionRefused("out_of_range", now)


class CommandRange:
    """The commands that the batteries of one agent permit, prepared for a quick check."""

    def __init__(self, homes: Homes, own: slice) -> None:
        self.count: int = own.stop - own.start
        self.bytes_max = BYTES_BASE + BYTES_PER_HOME * self.count
        self._min_kw = -homes.discharge_max_kw[own] - POWER_TOLERANCE_KW
        self._max_kw = homes.charge_max_kw[own] + POWER_TOLERANCE_KW
        self._few = list(zip(self._min_kw.tolist(), self._max_kw.tolist(), strict=True))[:FEW]

    def permits(self, battery_kw: list[float] | Floats) -> bool:
        """Whether there is one command for each home, within its power limits."""
        if len(battery_kw) != self.count:
            return False
        if self.count <= FEW:
            return all(lower <= kw <= upper for kw, (lower, upper) in zip(battery_kw, self._few, strict=True))
        commands_kw = np.asarray(battery_kw)
        return bool(((commands_kw >= self._min_kw) & (commands_kw <= self._max_kw)).all())


def read_commands(
    payload: bytes, encoding: str, run: str, instance: str | None, now: SlotPhase, permitted: CommandRange
) -> tuple[SlotPhase, list[float] | Floats]:
    """Read a prosumer agent's commands, one for each home.

    Returns
    -------
    The phase that the action is for, and the commands, checked if the phase is ``now``. [kW]

    Raises
    ------
    ActionRefused, WireError
    """
    if len(payload) > permitted.bytes_max:
        raise ActionRefused("oversized")
    phase, action = _read(FleetActionStruct, payload, encoding, run, instance, now)
    if phase != now:
        return phase, action.battery_kw
    if not permitted.permits(action.battery_kw):
        raise ActionRefused("out_of_range", now)
    return now, action.battery_kw


def _read(
    kind: type[AnyAction], payload: bytes, encoding: str, run: str, instance: str | None, now: SlotPhase
) -> tuple[SlotPhase, AnyAction]:
    """Read an action quickly if it is the expected one; validate every field of any other."""
    action = read(kind, payload, encoding)
    if (
        action.slot == now.slot
        and action.day == now.day
        and action.phase == now.phase
        and action.instance == instance
        and action.run == run
    ):
        return now, action
    action = read_checked(kind, payload, encoding)
    if action.run != run:
        raise ActionRefused("wrong_run")
    if action.instance != instance:
        raise ActionRefused("foreign")
    return SlotPhase(action.day, action.slot, action.phase), action
