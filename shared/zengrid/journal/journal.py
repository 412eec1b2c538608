"""The journal: every run of a market, in one database."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Self, TypeVar

from zengrid.errors import JournalError, JournalUnavailableError
from zengrid.journal.database import Connection, Database, Durability, Row, Step, transact
from zengrid.journal.location import open_database
from zengrid.journal.run_view import RunInfo, RunView
from zengrid.journal.run_writer import RunWriter
from zengrid.journal.statements import SCHEMA_VERSION, Statements

T = TypeVar("T")


class Journal:
    """All runs in one database. Open it with ``Journal.open`` in a ``with`` block. Any thread may read from it."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._reader: Connection | None = None
        self._reading = threading.Lock()
        self._writing: list[RunWriter] = []

    @classmethod
    def open(cls, place: str | Path, *, durability: Durability = "normal", read_only: bool = False) -> Self:
        """Open a journal, or create it if there is none.

        Parameters
        ----------
        place:
            Path of an SQLite file, ``sqlite:///path``, or ``postgresql://user:password@host/name``.
        durability:
            ``normal``: a commit survives the death of the process; ``full``: also a power cut.
        read_only:
            Only read, from a journal that exists. Readers never make the writer wait.
        """
        journal = cls(open_database(place, durability, read_only=read_only))
        try:
            journal._check(read_only)
        except BaseException:
            journal.close()
            raise
        return journal

    @property
    def name(self) -> str:
        """Path or URL, for messages."""
        return self._database.name

    def begin(self, name: str, scenario: str, *, seed: int, dt_h: float, version: str) -> RunWriter:
        """Start a new run.

        Parameters
        ----------
        name:
            Must be new in this journal.
        scenario:
            The scenario file, as YAML.
        dt_h:
            Length of a slot. [h]
        version:
            Version of zengrid.
        """
        if any(info.name == name for info in self.runs()):
            raise JournalError(f"journal {self.name}: run {name!r} exists already; resume it, or choose another name")
        try:
            connection = self._database.connect()
            try:
                values = (name, scenario, int(seed), float(dt_h), version, time.time())
                connection.execute(self._database.statements.insert_run, values)
            finally:
                connection.close()
        except self._database.errors as error:
            raise JournalError(f"journal {self.name}: run {name!r} cannot begin: {error}") from error
        return self._write(self._info(name))

    def resume(self, which: str | int | None = None) -> RunWriter:
        """Continue an unfinished run, given by name or id; by default the latest."""
        info = self._info(which, unfinished=True)
        if info.finished_at is not None:
            raise JournalError(f"journal {self.name}: run {info.name!r} is finished and cannot be resumed")
        return self._write(info)

    def run(self, which: str | int | None = None) -> RunView:
        """Read a run, given by name or id; by default the latest."""
        return RunView(self.query, self._database.statements, self._info(which))

    def runs(self) -> list[RunInfo]:
        """All runs, oldest first."""
        return [RunInfo(*row) for row in self.query(self._database.statements.runs)]

    def query(self, sql: str, parameters: Row = ()) -> list[Row]:
        """Read with a connection that never makes the writer wait."""
        with self._reading:
            while True:
                kept = self._reader is not None
                try:
                    if self._reader is None:
                        self._reader = self._database.connect()
                    rows = self._reader.execute(sql, parameters).fetchall()
                    if not self._database.lasting:
                        self._drop_reader()
                    return rows
                except self._database.errors as error:
                    self._drop_reader()
                    # A kept connection may have been lost meanwhile: try once more with a new one.
                    if not kept:
                        reason = " ".join(str(error).split())
                        raise JournalUnavailableError(f"journal {self.name} cannot be read: {reason}") from error

    @property
    def statements(self) -> Statements:
        """The SQL statements of its database."""
        return self._database.statements

    def write(self, steps: Sequence[Step]) -> None:
        """Change rows that no clock writes, while clocks may be running. All steps or none take effect."""
        if not steps:
            return
        try:
            connection = self._database.connect()
            try:
                transact(connection, [self._database.begin], steps)
            finally:
                connection.close()
        except self._database.errors as error:
            raise JournalError(f"journal {self.name} cannot be changed: {error}") from error

    def check(self) -> list[str]:
        """Let the database check itself, without regard to the meaning of its rows; returns one line for each fault."""
        return self._ask(self._database.check)

    def size(self) -> int:
        """Space that it takes on disk. [byte]"""
        return self._ask(self._database.size)

    def alone(self) -> AbstractContextManager[None]:
        """Keep clocks out while another program writes; refused if a clock already writes to the same SQLite file."""
        return self._database.alone([(info.id, info.name) for info in self.runs()])

    def vacuum(self) -> None:
        """Return the space of deleted slots to the operating system."""
        with self._reading:
            self._drop_reader()
        try:
            self._database.vacuum()
        except self._database.errors as error:
            raise JournalError(f"journal {self.name} cannot be vacuumed: {error}") from error

    def copy_to(self, path: Path, progress: Callable[[int, int], None] | None = None) -> int:
        """Copy everything, as it is at this moment, into a new SQLite file; returns the number of slots.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        from zengrid.journal.database_copy import copy_database

        target = open_database(path, "full", read_only=False)
        try:
            source = self._database.connect()
            try:
                source.execute(self._database.snapshot)
                return copy_database(source, target, progress)
            finally:
                source.close()
        except target.errors as error:
            raise OSError(f"cannot be written: {error}") from error
        except self._database.errors as error:
            raise JournalError(f"journal {self.name} cannot be read: {error}") from error

    def _ask(self, question: Callable[[Connection], T]) -> T:
        try:
            connection = self._database.connect()
            try:
                return question(connection)
            finally:
                connection.close()
        except self._database.errors as error:
            raise JournalError(f"journal {self.name} cannot be read: {error}") from error

    def close(self) -> None:
        """Close everything opened through this journal."""
        for run in self._writing:
            run.close()
        with self._reading:
            self._drop_reader()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _drop_reader(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _write(self, info: RunInfo) -> RunWriter:
        try:
            run = RunWriter(self.query, self._database, info)
        except self._database.errors as error:
            raise JournalError(f"journal {self.name}: run {info.name!r} cannot be written: {error}") from error
        self._writing.append(run)
        return run

    def _info(self, which: str | int | None, *, unfinished: bool = False) -> RunInfo:
        runs = self.runs()
        if which is None:
            fitting = [info for info in runs if info.finished_at is None] if unfinished else runs
            missing = "no unfinished run" if unfinished else "no run"
        else:
            fitting = [info for info in runs if which == (info.id if isinstance(which, int) else info.name)]
            missing = f"no run {which!r}"
        if not fitting:
            names = ", ".join(info.name for info in runs[-10:]) or "none"
            raise JournalError(f"journal {self.name}: there is {missing} (latest runs: {names})")
        return fitting[-1]

    def _check(self, read_only: bool) -> None:
        """Raise JournalError unless this is a journal that this version of zengrid can use."""
        try:
            self._reader = self._database.connect()
            tables = self._database.tables(self._reader)
            if "zengrid_journal" not in tables:
                if tables or read_only:
                    holds = f"it holds the tables {', '.join(sorted(tables))}" if tables else "it is empty"
                    raise JournalError(f"{self.name} is not a zengrid journal: {holds}")
                self._database.create(self._reader)
            versions = [row[0] for row in self._reader.execute(self._database.statements.schema_version).fetchall()]
        except self._database.errors as error:
            reason = " ".join(str(error).split())
            raise JournalUnavailableError(f"journal {self.name} cannot be opened: {reason}") from error
        if not self._database.lasting:
            self._drop_reader()
        if versions != [SCHEMA_VERSION]:
            raise JournalError(
                f"journal {self.name} has schema version {', '.join(map(str, versions)) or 'none'}; this zengrid needs "
                f"{SCHEMA_VERSION}: use the zengrid that wrote it, or export it with that one (zengrid export) and "
                "begin a new journal (--journal)"
            )
