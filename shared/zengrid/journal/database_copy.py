"""Copies a journal row by row from any database into a new SQLite file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zengrid.journal.database import Connection, Database
from zengrid.journal.slot_columns import COLUMNS
from zengrid.journal.sql_tables import ROSTER, RUN, SLOT

ROWS = 200
"""Slots held in memory at a time."""


def copy_database(source: Connection, target: Database, progress: Callable[[int, int], None] | None) -> int:
    """Copy all runs, rosters and slots that a transaction of ``source`` sees; returns the number of slots."""
    connection = target.connect()
    try:
        target.create(connection)
        connection.execute(target.begin)
        for table in (RUN, ROSTER):
            names = [column.name for column in table.c]
            for row in source.execute(f"SELECT {', '.join(names)} FROM {table.name}").fetchall():
                connection.execute(_insert(table.name, names), row)
        names = ["run_id", *COLUMNS]
        stretches = source.execute(
            f"SELECT run_id, min(position), max(position) + 1 FROM {SLOT.name} GROUP BY run_id"
        ).fetchall()
        total, done = sum(end - start for _, start, end in stretches), 0
        for run, start, end in stretches:
            for first in range(start, end, ROWS):
                # The numbers come from the database itself, and no parameter style fits both kinds of databases.
                stretch = f"run_id = {run:d} AND position >= {first:d} AND position < {first + ROWS:d}"
                rows = source.execute(f"SELECT {', '.join(names)} FROM {SLOT.name} WHERE {stretch}").fetchall()
                for row in rows:
                    connection.execute(_insert(SLOT.name, names), row)
                done += len(rows)
                if progress is not None:
                    progress(done, total)
        connection.execute("COMMIT")
        # Move the log into the file, and sync the file to disk.
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        return done
    finally:
        connection.close()


def _insert(table: str, names: list[str]) -> Any:
    return f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})"
