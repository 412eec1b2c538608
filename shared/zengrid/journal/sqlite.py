"""The journal in an SQLite file, with a write-ahead log, one writer a run, and checkpoints in a thread."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from zengrid.errors import JournalError
from zengrid.journal.database import Connection, Durability, Step, transact
from zengrid.journal.file_lock import FileLock
from zengrid.journal.slot_columns import COUNTS, FIGURES
from zengrid.journal.sqlite_statements import SQLITE

BUSY_S = 5.0
"""How long to wait for another run that writes to the same file. [s]"""
_ARRAYS = 1 + len(COUNTS) + len(FIGURES)
"""Position in a slot's row at which its arrays begin, after its run, counts and figures."""
CHECKPOINT_BYTES = 8 * 2**20
"""Size of new log after which it is copied into the database. [byte]"""
LOG_PAGES_MAX = 16_384
"""Length of the log (64 MiB) at which the writer itself copies it and starts it again."""


class SqliteDatabase:
    """One file. Commits survive a killed process; a power cut only with durability ``full``."""

    errors: tuple[type[Exception], ...] = (sqlite3.Error, OSError)
    statements = SQLITE
    begin = "BEGIN IMMEDIATE"
    snapshot = "BEGIN"

    def __init__(self, path: Path, durability: Durability, *, read_only: bool) -> None:
        self.name = str(path)
        self.lasting = True
        self._path = path.absolute()
        self._file = str(self._path)
        self._inode: int | None = None
        self._mode = "ro" if read_only else "rwc"
        self._synchronous = "FULL" if durability == "full" else "NORMAL"
        if read_only and not self._path.exists():
            raise JournalError(f"journal {path}: there is no such file")
        if not self._path.parent.is_dir():
            raise JournalError(f"journal {path}: there is no directory {self._path.parent}")

    def connect(self) -> sqlite3.Connection:
        """Open the file; the first connection of a writer creates it."""
        # Reading beside a log needs an index file. If none can be created and there is no log, the file is complete.
        may_index = self._mode != "ro" or os.access(self._path.parent, os.W_OK)
        self.lasting = may_index or Path(f"{self._path}-wal").exists()
        uri = f"{self._path.as_uri()}?mode={self._mode}{'' if self.lasting else '&immutable=1'}"
        # Its holder must make sure that one thread at a time uses the connection.
        connection = sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
        connection.execute(f"PRAGMA synchronous={self._synchronous}")
        self._mode = self._mode.removesuffix("c")
        return connection

    def check_present(self) -> None:
        """Raise OSError if the file was deleted or replaced: SQLite would keep writing to the old one."""
        found = os.stat(self._file).st_ino  # noqa: PTH116 - for every slot, and a third of the time of Path.stat
        if self._inode is None:
            self._inode = found
        elif found != self._inode:
            raise FileNotFoundError(f"{self._path} was replaced by another file")

    def tables(self, connection: Connection) -> set[str]:
        """All tables of the file: it belongs to the journal alone."""
        return {
            name for (name,) in connection.execute("SELECT name FROM sqlite_schema WHERE type = 'table'").fetchall()
        }

    def create(self, connection: Connection) -> None:
        """Create the tables; a second process waits for the first."""
        connection.execute("PRAGMA journal_mode=WAL")
        transact(connection, [self.begin], [(sql, ()) for sql in SQLITE.create])

    def writer(self, run_id: int, run_name: str) -> SqliteWriter:
        """Become the one writer of a run."""
        lock = FileLock.take(Path(f"{self._path}-run{run_id}.lock"), f"journal {self.name}: run {run_name!r}")
        try:
            return SqliteWriter(self, lock)
        except BaseException:
            lock.release()
            raise

    def check(self, connection: Connection) -> list[str]:
        """Let SQLite check its pages; returns one line for each fault."""
        found = [str(text) for (text,) in connection.execute("PRAGMA quick_check(20)").fetchall()]
        return [] if found == ["ok"] else found

    @contextmanager
    def alone(self, runs: Sequence[tuple[int, str]]) -> Iterator[None]:
        """Keep clocks out: they would have to wait for each transaction of this process."""
        with ExitStack() as stack:
            for run_id, run_name in runs:
                lock = FileLock.take(Path(f"{self._path}-run{run_id}.lock"), f"journal {self.name}: run {run_name!r}")
                stack.callback(lock.release)
            yield

    def vacuum(self) -> None:
        """Rewrite the file without gaps."""
        connection = self.connect()
        try:
            connection.execute("VACUUM")
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
        finally:
            connection.close()

    def size(self, connection: Connection) -> int:
        """The file and its log. [byte]"""
        files = (self._path, Path(f"{self._path}-wal"))
        return sum(path.stat().st_size for path in files if path.exists())


class SqliteWriter:
    """The one writer of a run."""

    def __init__(self, database: SqliteDatabase, lock: FileLock) -> None:
        database.check_present()
        self._database = database
        self._lock = lock
        self._connection = database.connect()
        self._connection.execute(f"PRAGMA wal_autocheckpoint={LOG_PAGES_MAX}")
        self._checkpointer = _Checkpointer(database)

    def commit(self, steps: Sequence[Step]) -> None:
        """Carry out all steps in one transaction."""
        self._database.check_present()
        if len(steps) == 1:
            # A statement alone is a transaction.
            self._connection.execute(*steps[0])
        else:
            transact(self._connection, [self._database.begin], steps)
        self._checkpointer.wrote(sum(map(len, steps[-1][1][_ARRAYS:])))

    def close(self) -> None:
        """Release the right; whatever was not committed is undone."""
        self._checkpointer.close()
        self._connection.close()
        self._lock.release()


class _Checkpointer:
    """Copies the log into the database in a thread of its own, so that no slot waits for the sync to disk."""

    _PAGES_BYTES = 2 * 4096
    """Bytes that a slot adds to the log besides its arrays, because whole pages are written."""

    def __init__(self, database: SqliteDatabase) -> None:
        self._database = database
        self._pending = 0
        self._due = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="journal-checkpoint", daemon=True)
        self._thread.start()

    def wrote(self, size: int) -> None:
        self._pending += size + self._PAGES_BYTES
        if self._pending >= CHECKPOINT_BYTES:
            self._pending = 0
            self._due.set()

    def close(self) -> None:
        self._ended = True
        self._due.set()
        self._thread.join()

    def _run(self) -> None:
        while self._due.wait() and not self._ended:
            self._due.clear()
            # On a full disk the log stays as it is, and the next commit that needs space reports it.
            with suppress(sqlite3.Error):
                connection = self._database.connect()
                try:
                    connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
                finally:
                    connection.close()
