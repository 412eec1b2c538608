"""Finds the database that a journal's path or URL names."""

from __future__ import annotations

from pathlib import Path

from zengrid.errors import JournalError
from zengrid.journal.database import Database, Durability


def open_database(place: str | Path, durability: Durability, *, read_only: bool) -> Database:
    """Choose the database that a path or URL names; nothing is connected yet.

    Raises
    ------
    JournalError
        The URL is of another kind, or the file or directory does not exist.
    """
    if durability not in ("normal", "full"):
        raise JournalError(f"durability = {durability!r}: permitted: 'normal' or 'full'")
    text = str(place)
    scheme, separator, rest = text.partition("://")
    if not separator or scheme == "sqlite":
        # sqlite:///relative.db and sqlite:////absolute.db, as SQLAlchemy spells them.
        path = rest.removeprefix("/") if separator else text
        if path in ("", ":memory:"):
            raise JournalError(f"journal = {text!r}: must be a file, because a journal outlives its process")
        from zengrid.journal.sqlite import SqliteDatabase

        return SqliteDatabase(Path(path), durability, read_only=read_only)
    if scheme.partition("+")[0] in ("postgresql", "postgres"):
        from zengrid.journal.postgres import PostgresDatabase

        return PostgresDatabase(f"postgresql://{rest}", durability)
    raise JournalError(f"journal = {scheme}://...: permitted: a path, sqlite:///path or postgresql://...")
