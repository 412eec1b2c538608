"""One settled slot, which is also the state to resume from."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from zengrid.core.state import Exogenous, Settlement
from zengrid.errors import JournalError
from zengrid.journal.database import Row
from zengrid.journal.slot_columns import COLUMNS, COUNTS, FACILITY_ARRAYS, FIGURES, FLOAT, HOME_ARRAYS, stack

Floats = NDArray[np.float64]

_FIGURES = len(COUNTS)
_FACILITIES = _FIGURES + len(FIGURES)
_HOMES = _FACILITIES + len(FACILITY_ARRAYS)
"""Positions at which figures, arrays of facilities and arrays of homes begin."""


class BaselineSlot(NamedTuple):
    """The part of a slot without demand response that is kept; names and shapes are those of ``Settlement``."""

    soc: Floats
    bill: Floats
    profit: Floats
    facility_kw: Floats


class SlotRecord(NamedTuple):
    """A settled slot, in the order of the journal's columns.

    Powers are means over the slot [kW], money is for the whole slot [$]; signs and names are those of
    ``zengrid.core.state.Settlement``. Names that begin with ``baseline_`` belong to the market
    without demand response.
    """

    position: int
    """0, 1, 2, ... in its run, without a gap"""
    day: int
    slot: int
    roster_version: int
    grid_fallback: bool
    """the grid agent did not answer, so its last price was kept"""
    settled_at: float
    """Unix time [s]"""
    buy_price: float
    """[$/kWh]"""
    sell_price: float
    """[$/kWh]"""
    demand_kw: float
    export_kw: float
    """sum of the homes' exports"""
    consumer_kw: float
    """sum of the plain consumers"""
    revenue: float
    payments: float
    """sum over the homes of the grid's payments for exports"""
    profit: float
    lost_load_cost: float
    curtailed_kw: float
    home_curtailed_kw: float
    """sum over the homes"""
    unserved_kw: float
    home_unserved_kw: float
    """sum over the homes"""
    baseline_profit: float
    facility_kw: Floats
    """(facility,)"""
    facility_cost: Floats
    """(facility,)"""
    baseline_facility_kw: Floats
    """(facility,)"""
    soc: Floats
    """(home,) at the end of the slot [-]"""
    battery_kw: Floats
    """(home,)"""
    injection_kw: Floats
    """(home,) at the meter, > 0 exports"""
    pv_kw: Floats
    """(home,)"""
    load_kw: Floats
    """(home,)"""
    bill: Floats
    """(home,)"""
    baseline_soc: Floats
    """(home,) at the end of the slot [-]"""
    baseline_bill: Floats
    """(home,)"""
    fallback: NDArray[np.bool_]
    """(home,) its agent did not answer, so the conventional rule was used"""

    @classmethod
    def of(
        cls,
        position: int,
        day: int,
        slot: int,
        settled_at: float,
        buy_price: float,
        exogenous: Exogenous,
        settled: Settlement,
        baseline: BaselineSlot | Settlement,
        fallback: NDArray[np.bool_],
        grid_fallback: bool,
        roster_version: int,
    ) -> Self:
        """Combine what the core settled for the market and for its baseline."""
        return cls(
            position=position,
            day=day,
            slot=slot,
            settled_at=settled_at,
            buy_price=buy_price,
            sell_price=float(exogenous.sell_price),
            demand_kw=float(settled.demand_kw),
            export_kw=float(settled.export_kw),
            consumer_kw=float(np.add.reduce(exogenous.consumer_kw)),
            revenue=float(settled.revenue),
            payments=float(settled.payments),
            profit=float(settled.profit),
            lost_load_cost=float(settled.lost_load_cost),
            curtailed_kw=float(settled.curtailed_kw),
            home_curtailed_kw=float(np.add.reduce(settled.home_curtailed_kw)),
            unserved_kw=float(settled.unserved_kw),
            home_unserved_kw=float(np.add.reduce(settled.home_unserved_kw)),
            facility_kw=settled.facility_kw,
            facility_cost=settled.facility_cost,
            grid_fallback=grid_fallback,
            roster_version=roster_version,
            soc=settled.soc,
            battery_kw=settled.battery_kw,
            injection_kw=settled.injection_kw,
            pv_kw=exogenous.pv_kw,
            load_kw=exogenous.load_kw,
            bill=settled.bill,
            fallback=fallback,
            baseline_soc=baseline.soc,
            baseline_bill=baseline.bill,
            baseline_profit=float(baseline.profit),
            baseline_facility_kw=baseline.facility_kw,
        )

    def encode(self, homes: int) -> Row:
        """Return the row of this record; raises JournalError unless every array of homes has ``homes`` values."""
        cells: tuple[Any, ...] = self
        for name, array in zip(HOME_ARRAYS, cells[_HOMES:], strict=True):
            if array.shape != (homes,):
                raise JournalError(f"{name} has shape {array.shape}: the roster has {homes} homes")
        return (
            *map(int, cells[:_FIGURES]),
            *map(float, cells[_FIGURES:_FACILITIES]),
            *[(array if array.dtype is FLOAT else array.astype(FLOAT)).tobytes() for array in cells[_FACILITIES:-1]],
            self.fallback.astype(np.uint8, copy=False).tobytes(),
        )

    @classmethod
    def decode(cls, row: Row) -> Self:
        """Read what ``encode`` wrote."""
        values = dict(zip(COLUMNS, row, strict=True))
        for name in (*FACILITY_ARRAYS, *HOME_ARRAYS):
            values[name] = stack(name, [values[name]])[0]
        values["grid_fallback"] = bool(values["grid_fallback"])
        return cls(**values)
