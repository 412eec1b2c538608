"""Journals to test with: SQLite files always, and a PostgreSQL server of our own for the slow tests."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import NamedTuple

import pytest

from zengrid.journal import Journal

NUMBERS = count()


class Server(NamedTuple):
    """A PostgreSQL server that listens on a socket in its own folder."""

    folder: Path
    programs: Path

    def url(self, name: str = "postgres") -> str:
        return f"postgresql://postgres@/{name}?host={self.folder}"

    def control(self, *command: str) -> None:
        # The server refuses to be run by root.
        user = "postgres" if os.geteuid() == 0 else None
        arguments = [str(self.programs / "pg_ctl"), "-D", str(self.folder / "data"), "-s", "-w", *command]
        subprocess.run(arguments, check=True, user=user, cwd=self.folder, stdout=subprocess.DEVNULL, timeout=60)

    def start(self) -> None:
        self.control("start", "-l", str(self.folder / "log"), "-o", f"-k {self.folder} -c listen_addresses= -F")

    def stop(self) -> None:
        self.control("stop", "-m", "immediate")


@pytest.fixture(scope="session")
def postgres() -> Iterator[Server]:
    pytest.importorskip("psycopg", reason="needs the extra postgres")
    found = [*Path("/usr/lib/postgresql").glob("*/bin/initdb"), *map(Path, filter(None, [shutil.which("initdb")]))]
    if not found:
        pytest.skip("needs PostgreSQL's server (Debian: apt-get install postgresql)")
    # A socket's path may have 107 characters, and the server's user must be able to reach it.
    with tempfile.TemporaryDirectory(prefix="zengrid-pg-", dir="/tmp", ignore_cleanup_errors=True) as folder:
        user = None
        if os.geteuid() == 0:
            try:
                user = pwd.getpwnam("postgres").pw_name
            except KeyError:
                pytest.skip("PostgreSQL needs a user other than root, and there is no user postgres")
            shutil.chown(folder, user)
        server = Server(Path(folder), found[0].resolve().parent)
        make = [
            str(server.programs / "initdb"),
            "-D",
            str(server.folder / "data"),
            "-A",
            "trust",
            "-U",
            "postgres",
            "-N",
        ]
        subprocess.run(make, check=True, user=user, cwd=folder, stdout=subprocess.DEVNULL, timeout=120)
        server.start()
        try:
            yield server
        finally:
            server.stop()


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.slow)])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where an empty journal can be opened, in either kind of database."""
    if request.param == "sqlite":
        return str(tmp_path / "zengrid.db")
    server: Server = request.getfixturevalue("postgres")
    return new_database(server)


@pytest.fixture
def journal(place: str) -> Iterator[Journal]:
    with Journal.open(place) as opened:
        yield opened


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a journal in an SQLite file can be opened."""
    return tmp_path / "zengrid.db"


def new_database(server: Server) -> str:
    import psycopg

    name = f"journal{next(NUMBERS)}"
    with psycopg.connect(server.url(), autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return server.url(name)
