"""Interface between the journal and a database: connections, transactions, and one writer for each run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Literal, Protocol

from zengrid.journal.statements import Statements

Durability = Literal["normal", "full"]
Row = tuple[Any, ...]
Step = tuple[str, Row]
"""A statement and its parameters."""


class Cursor(Protocol):
    """The result of a statement."""

    def fetchone(self) -> Any: ...
    def fetchall(self) -> list[Any]: ...


class Connection(Protocol):
    """A connection that commits each statement, unless one of them begins a transaction."""

    def execute(self, sql: Any, parameters: Any = ..., /) -> Cursor: ...
    def close(self) -> None: ...


class Writer(Protocol):
    """Holds the right to write one run until it is closed or its process dies."""

    def commit(self, steps: Sequence[Step]) -> None:
        """Carry out all steps in one transaction."""

    def close(self) -> None:
        """Release the right; whatever was not committed is undone."""


class Database(Protocol):
    """One kind of database at one place."""

    name: str
    """path or URL without password, for messages"""
    errors: tuple[type[Exception], ...]
    """exceptions that its connections and writers raise"""
    statements: Statements
    begin: str
    """begins a transaction that writes"""
    snapshot: str
    """begins a transaction that reads, and does not see later writes"""
    lasting: bool
    """whether the latest connection, if it is kept, will see what other processes write"""

    def connect(self) -> Connection:
        """Open a connection; reading through one never makes a writer wait."""

    def tables(self, connection: Connection) -> set[str]:
        """Names of the journal's tables, and of others with which it must not share the database."""

    def create(self, connection: Connection) -> None:
        """Create the tables in one transaction; safe if another process does the same at this moment."""

    def writer(self, run_id: int, run_name: str) -> Writer:
        """Become the one writer of a run."""

    def check(self, connection: Connection) -> list[str]:
        """Let the database check its pages; returns one line for each fault."""

    def alone(self, runs: Sequence[tuple[int, str]]) -> AbstractContextManager[None]:
        """Keep out the writers of these runs if they would have to wait for this process.

        Raises
        ------
        JournalError
            One of the runs has a writer.
        """

    def vacuum(self) -> None:
        """Return the space of deleted slots."""

    def size(self, connection: Connection) -> int:
        """Space that the journal takes. [byte]"""


def transact(connection: Connection, begin: Sequence[str], steps: Sequence[Step]) -> None:
    """Carry out several steps in one transaction. If it fails, close the connection."""
    for sql in begin:
        connection.execute(sql)
    for sql, parameters in steps:
        connection.execute(sql, parameters)
    connection.execute("COMMIT")
