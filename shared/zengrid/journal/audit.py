"""Whether a journal holds together: every slot once, energy and money balanced, the rosters its own."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.columns import COUNTS
from zengrid.journal.roster import Roster
from zengrid.journal.view import RunView

Floats = NDArray[np.float64]

TOLERANCE = 1e-9
"""Largest imbalance, in kWh and $ a slot; relative to the slot's total where that is more than 1."""
FINDINGS_MAX = 100


def audit(run: RunView) -> list[str]:
    """Check everything the journal holds of a run; one line for each finding, none if all is well.

    What crosses a meter is checked against ``pv - load - battery`` and the bills; what the market sells against homes,
    consumers and facilities; money against energy and prices; each slot against the one before it.
    """
    while True:
        since = run.kept_from()
        # Damaged arrays hold anything; what comes of calculating with it is found below.
        with np.errstate(all="ignore"):
            findings = _audit(run, since)
        # Slots that are pruned meanwhile are no gap.
        if not findings or run.kept_from() == since:
            return findings


def _audit(run: RunView, since: int) -> list[str]:
    findings: list[str] = []
    before: tuple[int, int, int] | None = None
    try:
        rosters = run.rosters()
        for block in run.blocks():
            findings += _sequence(block, before, run.info.slots_per_day, since)
            before = int(block["position"][-1]), int(block["day"][-1]), int(block["slot"][-1])
            findings += _rosters(block, rosters)
            for name, residual, scale in _balances(block, run.info.dt_h):
                findings += _beyond(block, name, residual, scale)
            findings += _values(block)
            if len(findings) >= FINDINGS_MAX:
                return [*findings[:FINDINGS_MAX], "and more"]
    except JournalError as error:
        findings.append(str(error))
    return findings


def _sequence(block: Block, before: tuple[int, int, int] | None, slots_per_day: int, since: int) -> list[str]:
    """Each slot follows the one before it."""
    position, day, slot = (block[name] for name in ("position", "day", "slot"))
    if before is not None:
        position, day, slot = (
            np.concatenate([[last], now]) for last, now in zip(before, (position, day, slot), strict=True)
        )
    elif position[0] != since:
        return [f"the first slot has position {position[0]}, not {since}"]
    time = day * slots_per_day + slot
    broken = np.flatnonzero((np.diff(position) != 1) | (np.diff(time) != 1))
    return [
        f"position {position[i]} (day {day[i]}, slot {slot[i]}) is followed by "
        f"position {position[i + 1]} (day {day[i + 1]}, slot {slot[i + 1]})"
        for i in broken
    ]


def _rosters(block: Block, rosters: list[tuple[int, Roster]]) -> list[str]:
    """Each slot stands under the roster in force."""
    starts = np.array([start for start, _ in rosters])
    versions = np.array([roster.version for _, roster in rosters])
    in_force = versions[np.searchsorted(starts, block["position"], side="right") - 1]
    return [
        f"{_where(block, i)}: roster version {block.roster.version}, but {in_force[i]} is in force"
        for i in np.flatnonzero(in_force != block.roster.version)
    ]


def _balances(block: Block, dt_h: float) -> Iterator[tuple[str, Floats, Floats]]:
    """Name, residual and scale of each balance, ``(slot,)`` in kWh or $."""
    buy, sell = block["buy_price"], block["sell_price"]
    injection = block["injection_kw"]
    export, imports = np.maximum(injection, 0.0), np.maximum(-injection, 0.0)
    beyond_meter = block["pv_kw"] - block["load_kw"] - block["battery_kw"] - injection
    demand, facilities = block["demand_kw"] * dt_h, block["facility_kw"].sum(-1) * dt_h
    energy = np.abs(demand) + facilities + np.abs(beyond_meter).sum(-1) * dt_h

    yield "exports", (block["export_kw"] - export.sum(-1)) * dt_h, energy
    yield "demand = consumers + imports", demand - (block["consumer_kw"] + imports.sum(-1)) * dt_h, energy
    yield (
        "facilities + unserved = demand - exports + curtailed",
        facilities + (block["unserved_kw"] + block["export_kw"] - block["curtailed_kw"]) * dt_h - demand,
        energy,
    )
    yield "curtailed at meters", (np.maximum(beyond_meter, 0.0).sum(-1) - block["home_curtailed_kw"]) * dt_h, energy
    yield "unserved at meters", (np.maximum(-beyond_meter, 0.0).sum(-1) - block["home_unserved_kw"]) * dt_h, energy

    bill, revenue, payments = block["bill"], block["revenue"], block["payments"]
    cost = block["facility_cost"].sum(-1)
    money = np.abs(revenue) + np.abs(payments) + np.abs(cost) + np.abs(block["lost_load_cost"])
    expected = imports * (sell * dt_h)[:, None] - export * (buy * dt_h)[:, None]
    yield "bills", np.abs(bill - expected).max(-1, initial=0.0), money
    yield "payments", payments - block["export_kw"] * buy * dt_h, money
    yield "revenue", revenue - demand * sell, money
    yield (
        "bills + consumers = revenue - payments",
        bill.sum(-1) + block["consumer_kw"] * sell * dt_h - revenue + payments,
        money,
    )
    yield "profit", block["profit"] - (revenue - cost - payments - block["lost_load_cost"]), money


def _beyond(block: Block, name: str, residual: Floats, scale: Floats) -> list[str]:
    # Written so that a NaN is found, too.
    broken = np.flatnonzero(~(np.abs(residual) <= TOLERANCE * np.maximum(scale, 1.0)))
    return [f"{_where(block, i)}: {name}: off by {residual[i]:.3g}" for i in broken]


def _values(block: Block) -> list[str]:
    """Everything is a number, and every battery within its walls."""
    findings = [
        f"{_where(block, i)}: {name} is not finite"
        for name, values in block.columns.items()
        if name not in COUNTS
        for i in np.flatnonzero(~np.isfinite(values.reshape(len(block), -1)).all(-1))
    ]
    for name in ("soc", "baseline_soc"):
        outside = (block[name] < 0.0) | (block[name] > 1.0)
        findings += [
            f"{_where(block, i)}: {name} of home {block.roster.homes[j]} is {block[name][i, j]}"
            for i, j in np.argwhere(outside)
        ]
    return findings


def _where(block: Block, i: np.integer[Any]) -> str:
    return f"position {block['position'][i]} (day {block['day'][i]}, slot {block['slot'][i]})"
