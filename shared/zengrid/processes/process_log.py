"""Log files of supervised processes: limited in size, and quoted when a process fails."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path

from zengrid import logs

PRIVATE = 0o600
"""Mode of logs: only their owner can read them, since they hold paths and data from others."""
MAX_BYTES = 1_000_000
"""A larger log is moved to ``NAME.log.1``, which replaces the previous one. [byte]"""


def log_size(log: Path) -> int:
    """The size of the log, 0 if there is none. [byte]"""
    try:
        return log.stat().st_size
    except OSError:
        return 0


def make_log_folder(folder: Path) -> None:
    """Make a folder for logs that only its owner can read; an existing folder stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)


def _private(path: str | os.PathLike[str], flags: int) -> int:
    """Open a log, and restrict it to its owner."""
    descriptor = os.open(path, flags, PRIVATE)
    with suppress(PermissionError):  # it belongs to another user, who lets this process write to it
        os.fchmod(descriptor, PRIVATE)
    return descriptor


def append_line(log: Path, text: str) -> None:
    """Append a line to a log."""
    with open(log, "a", encoding="utf-8", opener=_private) as file:
        file.write(f"{text}\n")


def start_log(log: Path) -> int:
    """Write a heading before a process starts, and return the position behind it. [byte]"""
    limit_log(log)
    append_line(
        log, logs.format_line("started") if logs.is_json() else f"--- {time.strftime('%Y-%m-%d %H:%M:%S')} started"
    )
    return log_size(log)


def limit_log(log: Path) -> bool:
    """Move a log that is too large, also while its process writes; return whether it was moved."""
    if log_size(log) <= MAX_BYTES:
        return False
    # The process appends: emptying the file is enough, and renaming it would not stop its growth.
    with log.open("rb") as file:
        file.seek(-MAX_BYTES, os.SEEK_END)
        with open(log.with_name(log.name + ".1"), "wb", opener=_private) as aside:
            aside.write(file.read())
    os.truncate(log, 0)
    return True


def read_last_lines(log: Path, since: int = 0, lines: int = 5) -> list[str]:
    """The last non-empty lines that were written since a position."""
    try:
        with log.open("rb") as file:
            file.seek(max(min(since, log_size(log)), log_size(log) - 16_384))
            text = file.read().decode(errors="replace")
    except OSError:
        return []
    return [logs.printable(_sentence(line.rstrip())) for line in text.splitlines() if line.strip()][-lines:]


def _sentence(line: str) -> str:
    """The text of a line for a person, which may be a sentence or a JSON object."""
    if not line.startswith("{"):
        return line
    try:
        return str(json.loads(line)["event"])
    except (ValueError, KeyError, RecursionError):
        return line
