"""A slot that was played, and its record as the journal, the public and operators get it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.state import Exogenous, Settlement
from zengrid.journal import RosterRecord, SlotRecord
from zengrid.journal.slot_record import BaselineSlot
from zengrid.wire.slots import HomeColumns, SettledSlot
from zengrid_clock.agent_registry import GRID

if TYPE_CHECKING:
    from collections.abc import Iterable

    from zengrid.scenario import HomeSpec
    from zengrid_clock.agent_registry import MarketAgent


class PlayedSlot(NamedTuple):
    """A slot that was settled: all that its record needs, whatever changes afterwards."""

    day: int
    slot: int
    buy_price: float
    """[$/kWh]"""
    exogenous: Exogenous
    settlement: Settlement
    baseline: BaselineSlot
    fallback: NDArray[np.bool_]
    """(home,) whether the fallback rule acted for it"""
    grid_fallback: bool
    """whether the last price was kept, because the grid agent did not answer"""
    roster: RosterRecord
    """whose homes these are"""
    durations_s: tuple[float, float, float]
    """of the price phase, the battery phase, and the settlement"""


class RosterVersions:
    """Numbers the rosters: a new version for each change of homes, agents, or the processes that play them."""

    def __init__(self) -> None:
        self._version = 0
        self._roster: RosterRecord | None = None

    def continue_after(self, version: int) -> None:
        """Number on from the last roster of a resumed run."""
        self._version = version

    def mark_changed(self) -> None:
        """The next roster gets a new version."""
        self._roster = None

    def current(self, homes: tuple[str, ...], specs: Iterable[HomeSpec], agents: Iterable[MarketAgent],
                slices: dict[str, slice]) -> RosterRecord:  # fmt: skip
        """The roster in force.

        Parameters
        ----------
        homes, specs:
            Ids and descriptions, in the order of all arrays.
        agents:
            All agents, the grid agent first.
        slices:
            Where the homes of each prosumer agent stand in the arrays.
        """
        if self._roster is None:
            self._version += 1
            self._roster = RosterRecord(
                version=self._version,
                homes=homes,
                specs=tuple(spec.model_dump(mode="json") for spec in specs),
                agents=tuple((it.id, homes[slices[it.id]] if it.id in slices else (), it.instance) for it in agents),
            )
        return self._roster


def slot_record(played: PlayedSlot, position: int) -> SlotRecord:
    """The journal's record of a slot."""
    return SlotRecord.of(
        position=position,
        day=played.day,
        slot=played.slot,
        settled_at=time.time(),
        buy_price=played.buy_price,
        exogenous=played.exogenous,
        settled=played.settlement,
        baseline=played.baseline,
        fallback=played.fallback,
        grid_fallback=played.grid_fallback,
        roster_version=played.roster.version,
    )


def public_slot(record: SlotRecord, roster: RosterRecord, run: str, dt_h: float, state: str) -> dict[str, Any]:
    """The fields of ``PublicSlot``: what everyone may know of a settled slot.

    Parameters
    ----------
    roster:
        Whose homes the arrays of the record are.
    run:
        Name of the market.
    dt_h:
        Slot length. [h]
    state:
        Of the market: running, paused or ended.
    """
    fallback_of = _agent_fallbacks(record, roster)
    return {
        "v": 1,
        "run": run,
        "day": record.day,
        "slot": record.slot,
        "position": record.position,
        "hour": record.slot * dt_h,
        "dt_h": dt_h,
        "state": state,
        "buy_price": record.buy_price,
        "sell_price": record.sell_price,
        "demand_kw": record.demand_kw,
        "export_kw": record.export_kw,
        "facility_kw": record.facility_kw,
        "facility_cost": record.facility_cost,
        "curtailed_kwh": (record.curtailed_kw + record.home_curtailed_kw) * dt_h,
        "unserved_kwh": (record.unserved_kw + record.home_unserved_kw) * dt_h,
        "homes": len(roster.homes),
        "acted": tuple(name for name, fallback in fallback_of.items() if not fallback),
        "fallback": tuple(name for name, fallback in fallback_of.items() if fallback),
    }


def settled_slot(record: SlotRecord, roster: RosterRecord, run: str, dt_h: float, *, homes: bool) -> SettledSlot:
    """A settled slot as operators see it; with ``homes``, each home's columns too."""
    return SettledSlot(
        **public_slot(record, roster, run, dt_h, "running"),
        profit=record.profit,
        baseline_profit=record.baseline_profit,
        baseline_facility_kw=record.baseline_facility_kw,
        detail=_home_columns(record, roster) if homes else None,
    )


def _home_columns(record: SlotRecord, roster: RosterRecord) -> HomeColumns:
    return HomeColumns(
        homes=roster.homes,
        soc=record.soc,
        battery_kw=record.battery_kw,
        injection_kw=record.injection_kw,
        pv_kw=record.pv_kw,
        load_kw=record.load_kw,
        bill=record.bill,
        baseline_soc=record.baseline_soc,
        baseline_bill=record.baseline_bill,
        fallback=tuple(home for home, fallback in zip(roster.homes, record.fallback, strict=True) if fallback),
    )


def _agent_fallbacks(record: SlotRecord, roster: RosterRecord) -> dict[str, bool]:
    """Whether the fallback rule acted, by agent; all homes of an agent share its fate."""
    home_fallback = record.fallback.tolist()
    found, first = {}, 0
    for name, homes, _ in roster.agents:
        found[name] = record.grid_fallback if name == GRID else bool(homes) and home_fallback[first]
        first += len(homes)
    return found
