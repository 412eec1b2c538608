"""Waits for signals without threads, handlers or busy loops: they are blocked, and taken one by one."""

from __future__ import annotations

import ctypes
import signal
import sys
from collections.abc import Iterable
from typing import Self

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SET_BYTES = 128
"""Size of ``sigset_t``."""
_LIBC = ctypes.CDLL(None)


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class Signals:
    """Takes the signals that ask a supervisor to end, and those of children that have ended. Use it with ``with``.

    Signals that the parent process ignores stay ignored, such as SIGHUP under ``nohup``.
    """

    def __init__(self) -> None:
        asked = [number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        self._taken = {signal.SIGCHLD, *asked}

    def __enter__(self) -> Self:
        self._before = signal.pthread_sigmask(signal.SIG_BLOCK, self._taken)
        return self

    def __exit__(self, *_: object) -> None:
        while _take(self._taken, 0.0) is not None:
            pass
        signal.pthread_sigmask(signal.SIG_SETMASK, self._before)

    def wait(self, timeout_s: float) -> signal.Signals | None:
        """The signal that asks to end, or None once a child has ended or the time is up."""
        taken = _take(self._taken, max(timeout_s, 0.0))
        return None if taken == signal.SIGCHLD else taken


def _take(numbers: Iterable[signal.Signals], timeout_s: float) -> signal.Signals | None:
    """Call the system's ``sigtimedwait``; return None if the time is up, or the process was stopped meanwhile (Ctrl-Z).

    In the latter case CPython's ``signal.sigtimedwait`` returns uninitialised memory, and so a signal that was never
    sent. A signal descriptor or an alarm cannot replace it: they miss signals that another thread takes.
    """
    wanted = sum(1 << (number - 1) for number in numbers).to_bytes(8, sys.byteorder).ljust(_SET_BYTES, b"\0")
    seconds, rest_s = divmod(timeout_s, 1.0)
    taken = _LIBC.sigtimedwait(wanted, None, ctypes.byref(_Timespec(int(seconds), int(rest_s * 1e9))))
    return signal.Signals(taken) if taken > 0 else None
