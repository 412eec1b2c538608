"""A lock on a file that the operating system releases when its process dies."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from zengrid.errors import JournalUnavailableError


class FileLock:
    """Held from ``take`` until ``release``; the file holds the owner's process id."""

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._descriptor = descriptor

    @classmethod
    def take(cls, path: Path, thing: str) -> Self:
        """Take the lock, or raise an error that names the process that holds it."""
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # The last owner may have removed the file between the two calls above. Then try again with a new one.
                if path.exists() and path.stat().st_ino == os.fstat(descriptor).st_ino:
                    # For the message below. The lock also holds without it, on a full disk.
                    with suppress(OSError):
                        os.ftruncate(descriptor, 0)
                        os.write(descriptor, str(os.getpid()).encode())
                    return cls(path, descriptor)
            except BlockingIOError:
                owner = os.read(descriptor, 20).decode() or "unknown"
                os.close(descriptor)
                raise JournalUnavailableError(
                    f"{thing} is being written by process {owner}: it has one writer at a time"
                ) from None
            except BaseException:
                os.close(descriptor)
                raise
            os.close(descriptor)

    def release(self) -> None:
        """Release the lock."""
        self._path.unlink(missing_ok=True)
        os.close(self._descriptor)
