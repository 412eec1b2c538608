"""What the journal needs of a database: connections, transactions, and that a run has one writer only."""

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
        """Give the right back; what was not committed is undone."""


class Database(Protocol):
    """One kind of database at one place."""

    name: str
    """for messages"""
    errors: tuple[type[Exception], ...]
    """what its connections and writers raise"""
    statements: Statements
    begin: str
    """begins a transaction that writes"""
    snapshot: str
    """begins one that reads, and sees nothing that is written meanwhile"""
    lasting: bool
    """whether the connection made last, if kept, will see what others write"""

    def connect(self) -> Connection:
        """Open a connection; reading through one never makes a writer wait."""

    def tables(self, connection: Connection) -> set[str]:
        """Tables that a journal must not share its place with, and its own."""

    def create(self, connection: Connection) -> None:
        """Create the tables in one transaction, even if another process does the same at this moment."""

    def writer(self, run_id: int, run_name: str) -> Writer:
        """Become the one writer of a run."""

    def check(self, connection: Connection) -> list[str]:
        """What the database itself finds wrong with its pages; one line each."""

    def alone(self, runs: Sequence[tuple[int, str]]) -> AbstractContextManager[None]:
        """Keep the writers of these runs away, where they would have to wait for another process.

        Raises
        ------
        JournalError
            One of them is there.
        """

    def vacuum(self) -> None:
        """Give the space of deleted slots back."""

    def size(self, connection: Connection) -> int:
        """What the journal takes. [byte]"""


def transact(connection: Connection, begin: Sequence[str], steps: Sequence[Step]) -> None:
    """Carry out several steps in one transaction; the connection is to be closed if that fails."""
    for sql in begin:
        connection.execute(sql)
    for sql, parameters in steps:
        connection.execute(sql, parameters)
    connection.execute("COMMIT")
