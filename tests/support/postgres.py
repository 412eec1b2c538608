"""A PostgreSQL server of our own, and a line to it that can be cut at the worst moment."""

from __future__ import annotations

import os
import pwd
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Literal, NamedTuple, Self

import pytest

NUMBERS = count()
PORT = 5432
"""Part of the name of a server's socket."""
READY = b"Z\x00\x00\x00\x05I"
"""ReadyForQuery, outside of a transaction: what was asked for is done, and committed."""


class PostgresServer(NamedTuple):
    """A PostgreSQL server that listens on a socket in its own folder."""

    folder: Path
    programs: Path

    def url(self, name: str = "postgres", folder: Path | None = None, address: str | None = None) -> str:
        """Of a database; through a line where its folder is given, through the network where an address is."""
        if address is not None:
            return f"postgresql://postgres@{address}:{PORT}/{name}"
        return f"postgresql://postgres@/{name}?host={folder or self.folder}"

    def new_database(self) -> str:
        """Make an empty database; returns its name."""
        import psycopg

        name = f"journal{next(NUMBERS)}"
        with psycopg.connect(self.url(), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE {name}".encode())
        return name

    def _control(self, *command: str) -> None:
        # The server refuses to be run by root.
        user = "postgres" if os.geteuid() == 0 else None
        arguments = [str(self.programs / "pg_ctl"), "-D", str(self.folder / "data"), "-s", "-w", *command]
        subprocess.run(arguments, check=True, user=user, cwd=self.folder, stdout=subprocess.DEVNULL, timeout=120)

    def start(self, address: str = "") -> None:
        """Start it, and wait until it answers; with an address, in a network, too."""
        options = f"-p {PORT} -k {self.folder} -c listen_addresses={address} -F"
        self._control("start", "-l", str(self.folder / "log"), "-o", options)

    def stop(self, mode: Literal["fast", "immediate"] = "immediate") -> None:
        """End it, as an administrator does (fast) or as a crash does (immediate)."""
        self._control("stop", "-m", mode)


@contextmanager
def postgres_server() -> Iterator[PostgresServer]:
    """A running server with nothing in it; skips the test where there can be none."""
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
        server = PostgresServer(Path(folder), found[0].resolve().parent)
        data = str(server.folder / "data")
        make = [str(server.programs / "initdb"), "-D", data, "-A", "trust", "-U", "postgres", "-N"]
        subprocess.run(make, check=True, user=user, cwd=folder, stdout=subprocess.DEVNULL, timeout=120)
        with (server.folder / "data" / "pg_hba.conf").open("a") as access:
            access.write("host all all 198.18.0.0/16 trust\n")  # networks of tests, see network_hosts.py
        server.start()
        try:
            yield server
        finally:
            server.stop()


class BreakableConnection:
    """Passes connections on to a server. Use it with ``with``; clients connect to the socket in ``folder``."""

    def __init__(self, server: PostgresServer) -> None:
        self._server = server
        self._ends: list[socket.socket] = []
        self._armed = threading.Event()
        self.cut = threading.Event()
        """Set once a connection was cut."""

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="zengrid-line-", dir="/tmp")
        self.folder = Path(self._folder.name)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.folder / f".s.PGSQL.{PORT}"))
        self._listener.listen()
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.mend()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._folder.cleanup()

    def cut_before_the_answer(self) -> None:
        """The server does what it is asked next, but whoever asked finds the line cut; the server does not notice."""
        self._armed.set()

    def mend(self) -> None:
        """The server notices, too, and forgets the connection that was cut."""
        while self._ends:
            self._ends.pop().close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._pass, args=(client,), daemon=True).start()

    def _pass(self, client: socket.socket) -> None:
        """One connection: what the client says, then what the server answers to it, until one of them ends."""
        with suppress(OSError), client:
            server = socket.socket(socket.AF_UNIX)
            server.connect(str(self._server.folder / f".s.PGSQL.{PORT}"))
            threading.Thread(target=self._answer, args=(server, client), daemon=True).start()
            while said := client.recv(1 << 16):
                server.sendall(said)
            if server not in self._ends:
                server.shutdown(socket.SHUT_WR)

    def _answer(self, server: socket.socket, client: socket.socket) -> None:
        with suppress(OSError):
            while said := server.recv(1 << 16):
                if said.endswith(READY) and self._armed.is_set():
                    self._armed.clear()
                    self._ends.append(server)
                    client.shutdown(socket.SHUT_RDWR)
                    self.cut.set()
                    return
                client.sendall(said)
        server.close()
        with suppress(OSError):
            client.shutdown(socket.SHUT_RDWR)
