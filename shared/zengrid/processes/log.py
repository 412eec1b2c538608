"""Log files of supervised processes: bounded in size, and quoted when a process fails."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from zengrid import logs

MAX_BYTES = 1_000_000
"""A larger log is set aside as ``NAME.log.1``, in place of the one before."""


def end_of(log: Path) -> int:
    """Where the log ends, and what a process writes next begins. [byte]"""
    try:
        return log.stat().st_size
    except FileNotFoundError:
        return 0


def begin(log: Path) -> int:
    """Mark where a process begins to write, and return that position. [byte]"""
    bound(log)
    with log.open("a", encoding="utf-8") as file:
        heading = logs.line("started") if logs.is_json() else f"--- {time.strftime('%Y-%m-%d %H:%M:%S')} started"
        file.write(f"{heading}\n")
    return end_of(log)


def bound(log: Path) -> bool:
    """Set a log aside that has grown too large, also while its process writes; tells whether it did."""
    if end_of(log) <= MAX_BYTES:
        return False
    # Its writer appends, so that emptying the file is enough; renaming it would not stop it from growing.
    with log.open("rb") as file:
        file.seek(-MAX_BYTES, os.SEEK_END)
        log.with_name(log.name + ".1").write_bytes(file.read())
    os.truncate(log, 0)
    return True


def tail(log: Path, since: int = 0, lines: int = 5) -> list[str]:
    """The last lines with text that were written since a position."""
    try:
        with log.open("rb") as file:
            file.seek(max(min(since, end_of(log)), end_of(log) - 16_384))
            text = file.read().decode(errors="replace")
    except FileNotFoundError:
        return []
    return [_words(line.rstrip()) for line in text.splitlines() if line.strip()][-lines:]


def _words(line: str) -> str:
    """What a line says to a person, be it a sentence or a JSON object."""
    if not line.startswith("{"):
        return line
    try:
        return str(json.loads(line)["event"])
    except (ValueError, KeyError):
        return line
