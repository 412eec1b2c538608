"""The journal's tables in SQLAlchemy Core, and its statements compiled for a database.

SQLAlchemy takes longer to import than the whole market to start. The statements for SQLite are therefore compiled
beforehand, into ``sqlite_statements.py``, by ``tools/make_sqlite_statements.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sqlalchemy import (
    BigInteger,
    BindParameter,
    Column,
    ColumnElement,
    Dialect,
    Double,
    ForeignKey,
    Integer,
    LargeBinary,
    MetaData,
    Select,
    Table,
    Text,
    bindparam,
    delete,
    func,
    insert,
    literal_column,
    select,
    update,
)
from sqlalchemy import text as text_
from sqlalchemy.schema import CreateTable
from sqlalchemy.sql.expression import ClauseElement

from zengrid.journal.slot_columns import COLUMNS, COUNTS, FACILITY_ARRAYS, FIGURES, FLOAT, HOME_ARRAYS, MARKET_COLUMNS
from zengrid.journal.statements import SCHEMA_VERSION, Statements

Compile = Callable[..., str]
"""Turns a statement and the names of its parameters, in order, into text."""

METADATA = MetaData()

JOURNAL = Table("zengrid_journal", METADATA, Column("schema_version", Integer, primary_key=True, autoincrement=False))

RUN = Table(
    "zengrid_run",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("name", Text, nullable=False, unique=True),
    Column("scenario", Text, nullable=False),
    Column("seed", BigInteger, nullable=False),
    Column("dt_h", Double, nullable=False),
    Column("version", Text, nullable=False),
    Column("started_at", Double, nullable=False),
    Column("finished_at", Double),
    # What was pruned, and what everything up to some slot adds up to: neither must ever be read again.
    Column("kept_from", Integer, nullable=False, server_default=text_("0")),
    Column("totals_until", Integer, nullable=False, server_default=text_("0")),
    Column("totals", LargeBinary),
)

ROSTER = Table(
    "zengrid_roster",
    METADATA,
    Column("run_id", ForeignKey(RUN.c.id), primary_key=True),
    Column("version", Integer, primary_key=True, autoincrement=False),
    Column("position", Integer, nullable=False),
    Column("body", LargeBinary, nullable=False),
)

SLOT = Table(
    "zengrid_slot",
    METADATA,
    Column("run_id", ForeignKey(RUN.c.id), primary_key=True),
    *(Column(name, Integer, nullable=False, primary_key=name == "position") for name in COUNTS),
    *(Column(name, Double, nullable=False) for name in FIGURES),
    *(Column(name, LargeBinary, nullable=False) for name in (*FACILITY_ARRAYS, *HOME_ARRAYS)),
    # One tree instead of a table and an index beside it: a commit writes half as many pages.
    sqlite_with_rowid=False,
)


def statements(dialect: Dialect) -> Statements:
    """Compile every statement for a database that takes parameters by position."""

    def text(statement: ClauseElement, *parameters: str) -> str:
        compiled = statement.compile(dialect=dialect)
        order = tuple(getattr(compiled, "positiontup", None) or ())
        if order != parameters:
            raise ValueError(f"parameters in the order {order}, not {parameters}:\n{compiled}")
        return " ".join(str(compiled).split())

    version: ColumnElement[int] = literal_column(str(SCHEMA_VERSION))
    unstamped = select(version).where(~select(JOURNAL.c.schema_version).exists())
    stamp = insert(JOURNAL).from_select(["schema_version"], unstamped)
    return Statements(
        create=(*(text(CreateTable(table, if_not_exists=True)) for table in METADATA.sorted_tables), text(stamp)),
        schema_version=text(select(JOURNAL.c.schema_version)),
        **_of_runs(text), **_of_rosters(text), **_of_slots(text),
    )  # fmt: skip


def _of_runs(text: Compile) -> dict[str, str]:
    """Statements about runs, by their names in ``Statements``."""
    this = RUN.c.id == bindparam("run_id")
    given = ("name", "scenario", "seed", "dt_h", "version", "started_at")
    values: dict[str, BindParameter[Any]] = {name: bindparam(name) for name in given}
    last_of_each = select(func.max(SLOT.c.position)).where(SLOT.c.run_id == RUN.c.id).scalar_subquery()
    slots = func.coalesce(last_of_each + literal_column("1"), literal_column("0"))
    infos = (RUN.c.id, RUN.c.name, RUN.c.seed, RUN.c.dt_h, RUN.c.version, RUN.c.started_at, RUN.c.finished_at)
    sums: dict[str, BindParameter[Any]] = {"totals_until": bindparam("until"), "totals": bindparam("totals")}
    return {
        "insert_run": text(insert(RUN).values(values).inline(), *given),
        "finish_run": text(
            update(RUN).where(this).values(finished_at=bindparam("finished_at")), "finished_at", "run_id"
        ),
        "runs": text(select(*infos, slots).order_by(RUN.c.id)),
        "scenario": text(select(RUN.c.scenario).where(this), "run_id"),
        "kept": text(select(RUN.c.kept_from, RUN.c.totals_until, RUN.c.totals).where(this), "run_id"),
        "keep_from": text(update(RUN).where(this).values(kept_from=bindparam("since")), "since", "run_id"),
        "write_totals": text(update(RUN).where(this).values(sums), "until", "totals", "run_id"),
    }


def _of_rosters(text: Compile) -> dict[str, str]:
    """Statements about rosters, by their names in ``Statements``."""
    of_run = ROSTER.c.run_id == bindparam("run_id")
    older = ROSTER.c.version < bindparam("version")
    ordered = select(ROSTER.c.version, ROSTER.c.position, ROSTER.c.body).where(of_run).order_by(ROSTER.c.version)
    return {
        "delete_rosters": text(delete(ROSTER).where(of_run, older), "run_id", "version"),
        "insert_roster": text(insert(ROSTER), "run_id", "version", "position", "body"),
        "rosters": text(ordered, "run_id"),
    }


def _of_slots(text: Compile) -> dict[str, str]:
    """Statements about slots, by their names in ``Statements``."""
    of_run = SLOT.c.run_id == bindparam("run_id")
    stretch = (of_run, SLOT.c.position >= bindparam("since"), SLOT.c.position < bindparam("until"))
    kept_from = select(RUN.c.kept_from).where(RUN.c.id == SLOT.c.run_id).scalar_subquery()
    first = func.coalesce(func.min(SLOT.c.position), literal_column("0"))

    def read(*columns: ColumnElement[Any]) -> Select[Any]:
        return select(*columns).where(*stretch).order_by(SLOT.c.position)

    def cut(array: str, width: int) -> ColumnElement[Any]:
        return func.substr(SLOT.c[array], bindparam(f"at_{array}", type_=Integer), literal_column(str(width)))

    cells = (*(cut(array, FLOAT.itemsize) for array in HOME_ARRAYS[:-1]), cut(HOME_ARRAYS[-1], 1))
    bounds = ("run_id", "since", "until")
    return {
        "last_position": text(select(func.max(SLOT.c.position)).where(of_run), "run_id"),
        "count": text(select(func.count()).select_from(SLOT).where(of_run, SLOT.c.position >= kept_from), "run_id"),
        "first_position": text(select(first).where(of_run), "run_id"),
        "delete_slots": text(delete(SLOT).where(*stretch), *bounds),
        "insert_slot": text(insert(SLOT), "run_id", *COLUMNS),
        "slots": text(read(*(SLOT.c[name] for name in COLUMNS)), *bounds),
        "market": text(read(*(SLOT.c[name] for name in MARKET_COLUMNS)), *bounds),
        "home": text(
            read(SLOT.c.position, SLOT.c.day, SLOT.c.slot, *cells), *(f"at_{name}" for name in HOME_ARRAYS), *bounds
        ),
    }
