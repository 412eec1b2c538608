"""The SQL that the journal speaks, as text for one kind of database."""

from __future__ import annotations

from dataclasses import dataclass

SCHEMA_VERSION = 4
"""Changes with the tables: a journal of another version is refused."""


@dataclass(frozen=True, slots=True)
class Statements:
    """Every statement takes its parameters by position, in the order given here."""

    create: tuple[str, ...]
    """() each, in one transaction; harmless where the tables are there"""
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
    """(run_id,) -> slots that are kept"""
    first_position: str
    """(run_id,) -> the first there is, or 0"""
    kept: str
    """(run_id,) -> first position that is kept, position up to which the totals go, totals"""
    keep_from: str
    """(first position that is kept, run_id)"""
    write_totals: str
    """(position up to which they go, totals, run_id)"""
    delete_slots: str
    """(run_id, since, until)"""
    delete_rosters: str
    """(run_id, version): all rosters before it"""
    insert_roster: str
    """(run_id, version, position, body)"""
    rosters: str
    """(run_id,) -> version, position, body; in order"""
    insert_slot: str
    """(run_id, *record.COLUMNS)"""
    slots: str
    """(run_id, since, until) -> record.COLUMNS; in order"""
    market: str
    """(run_id, since, until) -> record.MARKET_COLUMNS; in order"""
    home: str
    """(byte offset of a float) * (HOME_ARRAYS - 1), offset of the fallback byte, run_id, since, until"""
