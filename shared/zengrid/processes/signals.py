"""Waits for signals without threads, handlers or busy loops: they are blocked, and taken one by one."""

from __future__ import annotations

import signal
from typing import Self

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Signals:
    """Takes the signals that ask a supervisor to end, and those of children that ended. Use it with ``with``.

    What a parent ignores stays ignored, such as the hang-up under ``nohup``.
    """

    def __init__(self) -> None:
        asked = [number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        self._taken = {signal.SIGCHLD, *asked}

    def __enter__(self) -> Self:
        self._before = signal.pthread_sigmask(signal.SIG_BLOCK, self._taken)
        return self

    def __exit__(self, *_: object) -> None:
        while signal.sigtimedwait(self._taken, 0.0) is not None:
            pass
        signal.pthread_sigmask(signal.SIG_SETMASK, self._before)

    def wait(self, timeout_s: float) -> signal.Signals | None:
        """The signal that asks to end, or None once a child has ended or the time is up."""
        taken = signal.sigtimedwait(self._taken, max(timeout_s, 0.0))
        if taken is None or taken.si_signo == signal.SIGCHLD:
            return None
        return signal.Signals(taken.si_signo)
