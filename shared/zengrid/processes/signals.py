"""Waits for signals without threads, handlers or busy loops: they are blocked, and taken one by one."""

from __future__ import annotations

import ctypes
import math
import os
import select
import signal
import sys
from typing import Self

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_SET_BYTES = 128
"""Size of ``sigset_t``, and of what a read from a signal descriptor returns."""


class Signals:
    """Takes the signals that ask a supervisor to end, and those of children that ended. Use it with ``with``.

    What a parent ignores stays ignored, such as the hang-up under ``nohup``.
    """

    def __init__(self) -> None:
        asked = [number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        self._taken = {signal.SIGCHLD, *asked}

    def __enter__(self) -> Self:
        self._before = signal.pthread_sigmask(signal.SIG_BLOCK, self._taken)
        self._descriptor = _descriptor(self._taken)
        return self

    def __exit__(self, *_: object) -> None:
        while self._take(0.0) is not None:
            pass
        os.close(self._descriptor)
        signal.pthread_sigmask(signal.SIG_SETMASK, self._before)

    def wait(self, timeout_s: float) -> signal.Signals | None:
        """The signal that asks to end, or None once a child has ended or the time is up."""
        taken = self._take(timeout_s)
        return None if taken == signal.SIGCHLD else taken

    def _take(self, timeout_s: float) -> signal.Signals | None:
        # Not ``signal.sigtimedwait``: where a process was stopped for longer than it meant to wait (Ctrl-Z), CPython
        # returns memory that nobody filled, and so a signal that nobody sent.
        ready = select.poll()
        ready.register(self._descriptor, select.POLLIN)
        if not ready.poll(math.ceil(max(timeout_s, 0.0) * 1e3)):
            return None
        return signal.Signals(int.from_bytes(os.read(self._descriptor, _SET_BYTES)[:4], sys.byteorder))


def _descriptor(numbers: set[signal.Signals]) -> int:
    """What can be read while one of these signals is there: Linux' ``signalfd``, which Python does not have yet."""
    mask = sum(1 << (number - 1) for number in numbers).to_bytes(8, sys.byteorder).ljust(_SET_BYTES, b"\0")
    libc = ctypes.CDLL(None, use_errno=True)
    descriptor = int(libc.signalfd(-1, mask, os.O_CLOEXEC))
    if descriptor < 0:
        raise OSError(ctypes.get_errno(), "signalfd")
    return descriptor
