"""Checks a run of the journal: every slot once and under its roster, energy and money balanced, values possible."""

from __future__ import annotations

from typing import Any

import numpy as np

from zengrid.core.balances import balances
from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.roster_record import RosterRecord
from zengrid.journal.run_view import RunView
from zengrid.journal.slot_columns import COUNTS

FINDINGS_MAX = 100
"""Findings after which the audit stops."""


def audit(run: RunView) -> list[str]:
    """Check everything that the journal holds of a run; returns one line for each finding, none if all is well.

    Each slot must follow the one before it, stand under the roster in force, satisfy ``zengrid.core.balances``, and
    hold finite numbers with states of charge from 0 to 1.
    """
    while True:
        since = run.kept_from()
        # Damaged arrays hold any bits. What they lead to is found as imbalance or value below.
        with np.errstate(all="ignore"):
            findings = _audit(run, since)
        # Slots that were pruned meanwhile are not missing: audit again.
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
            findings += _imbalances(block, run.info.dt_h)
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


def _rosters(block: Block, rosters: list[tuple[int, RosterRecord]]) -> list[str]:
    """Each slot stands under the roster in force."""
    starts = np.array([start for start, _ in rosters])
    versions = np.array([roster.version for _, roster in rosters])
    in_force = versions[np.searchsorted(starts, block["position"], side="right") - 1]
    return [
        f"{_where(block, i)}: roster version {block.roster.version}, but {in_force[i]} is in force"
        for i in np.flatnonzero(in_force != block.roster.version)
    ]


def _imbalances(block: Block, dt_h: float) -> list[str]:
    """Energy and money balance in each slot."""
    return [
        f"{_where(block, i)}: {balance.name}: off by {balance.residual[i]:.3g}"
        for balance in balances(block.columns, dt_h)
        for i in np.flatnonzero(balance.broken)
    ]


def _values(block: Block) -> list[str]:
    """Every number is finite, and every state of charge from 0 to 1."""
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
