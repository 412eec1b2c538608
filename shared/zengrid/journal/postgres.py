"""The journal in a PostgreSQL database, given by URL; needs the extra ``postgres``."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from zengrid.errors import JournalError, JournalUnavailableError
from zengrid.journal.database import Connection, Durability, Step, transact
from zengrid.journal.slot_columns import HOME_ARRAYS

CONNECT_TIMEOUT_S = 10
KEEPALIVE = {"keepalives_idle": 10, "keepalives_interval": 5, "keepalives_count": 3}
"""When either side closes a silent connection [s], [s]. By default systems wait for hours, and so would the lock."""
SILENT_MS = 25_000
"""The same if data was sent and not acknowledged. [ms]"""
LOCK_SPACE = 0x7A656E67
"""First key of the advisory locks ("zeng"); the second is the run, and 0 while tables are created."""


class PostgresDatabase:
    """One database. Durability ``normal`` leaves the server's ``synchronous_commit`` as it is, ``full`` turns it on."""

    lasting = True
    begin = "BEGIN"
    snapshot = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY"

    def __init__(self, url: str, durability: Durability) -> None:
        try:
            import psycopg
        except ModuleNotFoundError as error:
            raise JournalError("journal = postgresql://...: this needs pip install 'zengrid[postgres]'") from error
        from sqlalchemy.engine import make_url
        from sqlalchemy.exc import ArgumentError

        from zengrid.journal.sql_tables import statements

        try:
            parsed = make_url(url).set(drivername="postgresql+psycopg")
            kind: Any = parsed.get_dialect()
            dialect = kind(paramstyle="format")
            self._arguments, self._options = dialect.create_connect_args(parsed)
        except (ArgumentError, ValueError) as error:
            raise JournalError(f"journal = postgresql://...: not a URL ({error})") from error
        self.name = parsed.set(drivername="postgresql").render_as_string(hide_password=True)
        self.errors: tuple[type[Exception], ...] = (psycopg.Error, OSError)
        self.statements = statements(dialect)
        self._durability = durability

    def connect(self) -> Any:
        """Open a connection."""
        import psycopg

        options = {"connect_timeout": CONNECT_TIMEOUT_S, **KEEPALIVE, "tcp_user_timeout": SILENT_MS, **self._options}
        connection = psycopg.connect(*self._arguments, autocommit=True, **options)
        settings = {f"tcp_{name}": value for name, value in KEEPALIVE.items()} | {"tcp_user_timeout": SILENT_MS}
        connection.execute("; ".join(f"SET {name} = {value}" for name, value in settings.items()))
        if self._durability == "full":
            connection.execute("SET synchronous_commit = on")
        return connection

    def tables(self, connection: Connection) -> set[str]:
        """The journal's own tables: a server may hold others beside them."""
        found = connection.execute("SELECT to_regclass('zengrid_journal')").fetchone()
        return {"zengrid_journal"} if found != (None,) else set()

    def create(self, connection: Connection) -> None:
        """Create the tables; a second process waits for the first."""
        lock = f"SELECT pg_advisory_xact_lock({LOCK_SPACE}, 0)"
        # The server would try to compress arrays that cannot be compressed: most of a commit's time at 10,000 homes.
        plain = [f"ALTER TABLE zengrid_slot ALTER COLUMN {name} SET STORAGE EXTERNAL" for name in HOME_ARRAYS]
        transact(connection, [self.begin, lock], [(sql, ()) for sql in (*self.statements.create, *plain)])

    def writer(self, run_id: int, run_name: str) -> PostgresWriter:
        """Become the one writer of a run; the server releases the lock when the connection ends."""
        connection = self.connect()
        got = connection.execute("SELECT pg_try_advisory_lock(%s, %s)", (LOCK_SPACE, run_id)).fetchone()
        if got != (True,):
            connection.close()
            raise JournalUnavailableError(
                f"journal {self.name}: run {run_name!r} is being written by another process: a run has one writer"
            )
        return PostgresWriter(connection)

    def check(self, connection: Connection) -> list[str]:
        """Nothing: a server checks its own pages (with ``pg_amcheck``)."""
        return []

    def alone(self, runs: Sequence[tuple[int, str]]) -> AbstractContextManager[None]:
        """Nothing: writers of a server do not wait for each other."""
        return nullcontext()

    def vacuum(self) -> None:
        """Let the server reuse the space; no writer waits for it."""
        connection = self.connect()
        try:
            connection.execute("VACUUM zengrid_slot, zengrid_roster, zengrid_run")
        finally:
            connection.close()

    def size(self, connection: Connection) -> int:
        """The tables with their indexes. [byte]"""
        names = ("zengrid_slot", "zengrid_roster", "zengrid_run")
        found = connection.execute(f"SELECT {' + '.join(f'pg_total_relation_size({name!r})' for name in names)}")
        return int(found.fetchone()[0])


class PostgresWriter:
    """The one writer of a run."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def commit(self, steps: Sequence[Step]) -> None:
        """Carry out all steps in one transaction."""
        if len(steps) == 1:
            self._connection.execute(*steps[0])
        else:
            transact(self._connection, ["BEGIN"], steps)

    def close(self) -> None:
        """Release the right; whatever was not committed is undone."""
        self._connection.close()
