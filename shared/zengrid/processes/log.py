"""Log files of supervised processes: bounded in size, and quoted when a process fails."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path

from zengrid import logs

PRIVATE = 0o600
"""Mode of logs: what a process tells, such as paths and what others sent it, is its owner's business alone."""
MAX_BYTES = 1_000_000
"""A larger log is set aside as ``NAME.log.1``, in place of the one before."""


def end_of(log: Path) -> int:
    """Where the log ends, and what a process writes next begins. [byte]"""
    try:
        return log.stat().st_size
    except OSError:
        return 0


def make_folder(folder: Path) -> None:
    """A folder for logs, for its owner alone; one that is there stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def _private(path: str | os.PathLike[str], flags: int) -> int:
    """Open a log, made for its owner alone; one from elsewhere becomes so."""
    descriptor = os.open(path, flags, PRIVATE)
    with suppress(PermissionError):  # somebody else's, who lets this process write to it
        os.fchmod(descriptor, PRIVATE)
    return descriptor


def append(log: Path, text: str) -> None:
    """Add a line of one's own."""
    with open(log, "a", encoding="utf-8", opener=_private) as file:
        file.write(f"{text}\n")


def begin(log: Path) -> int:
    """Mark where a process begins to write, and return that position. [byte]"""
    bound(log)
    append(log, logs.line("started") if logs.is_json() else f"--- {time.strftime('%Y-%m-%d %H:%M:%S')} started")
    return end_of(log)


def bound(log: Path) -> bool:
    """Set a log aside that has grown too large, also while its process writes; tells whether it did."""
    if end_of(log) <= MAX_BYTES:
        return False
    # Its writer appends, so that emptying the file is enough; renaming it would not stop it from growing.
    with log.open("rb") as file:
        file.seek(-MAX_BYTES, os.SEEK_END)
        with open(log.with_name(log.name + ".1"), "wb", opener=_private) as aside:
            aside.write(file.read())
    os.truncate(log, 0)
    return True


def tail(log: Path, since: int = 0, lines: int = 5) -> list[str]:
    """The last lines with text that were written since a position."""
    try:
        with log.open("rb") as file:
            file.seek(max(min(since, end_of(log)), end_of(log) - 16_384))
            text = file.read().decode(errors="replace")
    except OSError:
        return []
    return [logs.printable(_words(line.rstrip())) for line in text.splitlines() if line.strip()][-lines:]


def _words(line: str) -> str:
    """What a line says to a person, be it a sentence or a JSON object."""
    if not line.startswith("{"):
        return line
    try:
        return str(json.loads(line)["event"])
    except (ValueError, KeyError, RecursionError):
        return line
