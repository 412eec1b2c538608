"""Journals to test with: SQLite files always, and a PostgreSQL server of our own for the slow tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from support.postgres import PostgresServer, postgres_server
from zengrid.journal import Journal


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    with postgres_server() as server:
        yield server


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.slow)])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where an empty journal can be opened, in either kind of database."""
    if request.param == "sqlite":
        return str(tmp_path / "zengrid.db")
    server: PostgresServer = request.getfixturevalue("postgres")
    return server.url(server.new_database())


@pytest.fixture
def journal(place: str) -> Iterator[Journal]:
    with Journal.open(place) as opened:
        yield opened


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Where a journal in an SQLite file can be opened."""
    return tmp_path / "zengrid.db"
