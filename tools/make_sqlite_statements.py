"""Writes the journal's statements for SQLite into the library: ``python tools/make_sqlite_statements.py``.

Run it after a change to ``zengrid.journal.sql_tables``. A test fails while the file is out of date.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from sqlalchemy.dialects.sqlite import dialect

from zengrid import journal
from zengrid.journal.sql_tables import statements

TARGET = Path(journal.__file__).with_name("sqlite_statements.py")


def source() -> str:
    """Compile all statements and return the module that holds them."""
    compiled = statements(dialect(paramstyle="qmark"))
    lines = [
        '"""The statements for SQLite, written by ``tools/make_sqlite_statements.py``: do not edit."""',
        "",
        "from zengrid.journal.statements import Statements",
        "",
        "# fmt: off",
        "# ruff: noqa: E501",
        "SQLITE = Statements(",
    ]
    for field in fields(compiled):
        value = getattr(compiled, field.name)
        if isinstance(value, tuple):
            lines += [f"    {field.name}=(", *(f"        {item!r}," for item in value), "    ),"]
        else:
            lines.append(f"    {field.name}={value!r},")
    return "\n".join([*lines, ")", ""])


if __name__ == "__main__":
    TARGET.write_text(source(), encoding="utf-8")
