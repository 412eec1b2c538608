"""The journal's SQL statements, as text for one kind of database."""

from __future__ import annotations

from dataclasses import dataclass

SCHEMA_VERSION = 4
"""Version of the tables. A journal of another version is refused."""


@dataclass(frozen=True, slots=True)
class Statements:
    """Every statement takes its parameters by position, in the order given here."""

    create: tuple[str, ...]
    """() each, in one transaction; no effect if the tables exist"""
    schema_version: str
    """()"""
    insert_run: str
    """(name, scenario, seed, dt_h, version, started_at)"""
    finish_run: str
    """(finished_at, run_id)"""
    runs: str
    """() -> id, name, seed, dt_h, version, started_at, finished_at, slots; oldest first"""
    scenario: str
    """(run_id,)"""
    last_position: str
    """(run_id,)"""
    count: str
    """(run_id,) -> number of slots that are kept"""
    first_position: str
    """(run_id,) -> position of the first slot in the table, or 0"""
    kept: str
    """(run_id,) -> first position that is kept, position before which the totals end, totals"""
    keep_from: str
    """(first position that is kept, run_id)"""
    write_totals: str
    """(position before which they end, totals, run_id)"""
    delete_slots: str
    """(run_id, since, until)"""
    delete_rosters: str
    """(run_id, version): all rosters before it"""
    insert_roster: str
    """(run_id, version, position, body)"""
    rosters: str
    """(run_id,) -> version, position, body; in order"""
    insert_slot: str
    """(run_id, *COLUMNS)"""
    slots: str
    """(run_id, since, until) -> COLUMNS; in order"""
    market: str
    """(run_id, since, until) -> MARKET_COLUMNS; in order"""
    home: str
    """(byte offset of a float) * (HOME_ARRAYS - 1), offset of the fallback byte, run_id, since, until"""
