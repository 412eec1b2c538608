"""Keeps other processes from believing that nobody has an SQLite file open.

SQLite's locks belong to the process and go when *any* descriptor of the file is closed. Zenoh duplicates and closes
every descriptor of its process whenever a client connects, and with that all of them are gone. The next process that
opens the journal, even to read, would then take it for left behind by a crash and cut the shared index to nothing,
under the feet of the clock that has it mapped (SIGBUS). Locks of an open file description survive; to other processes
they look the same.
"""

from __future__ import annotations

import fcntl
import os
import struct
from pathlib import Path

_SHARED = 0x40000002, 510
"""Where SQLite marks a database file as in use. [byte, bytes]"""
_INDEX_IN_USE = 128, 1
"""The same for the index of its log."""


class InUse:
    """Marks a journal's file as in use until ``release``; only once SQLite itself has opened both its files."""

    def __init__(self, path: Path) -> None:
        self._descriptors: list[int] = []
        try:
            self._mark(path, *_SHARED)
            self._mark(path.with_name(f"{path.name}-shm"), *_INDEX_IN_USE)
        except BaseException:
            self.release()
            raise

    def _mark(self, path: Path, start: int, length: int) -> None:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        self._descriptors.append(descriptor)
        if hasattr(fcntl, "F_OFD_SETLK"):
            # struct flock of 64-bit Linux: type, whence, start, length, process.
            lock = struct.pack("hhqqi4x", fcntl.F_RDLCK, os.SEEK_SET, start, length, 0)
            fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, lock)

    def release(self) -> None:
        """Take the marks back."""
        while self._descriptors:
            os.close(self._descriptors.pop())
