"""Waits for signals without threads, handlers or busy loops: they are blocked, and taken one by one."""

from __future__ import annotations

import signal
from typing import Self

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
SOON_S = 1e-6
"""The shortest time that an alarm can be set to. [s]"""


class Signals:
    """Takes the signals that ask a supervisor to end, and those of children that ended. Use it with ``with``.

    What a parent ignores stays ignored, such as the hang-up under ``nohup``.
    """

    def __init__(self) -> None:
        asked = [number for number in ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        self._taken = {signal.SIGCHLD, signal.SIGALRM, *asked}

    def __enter__(self) -> Self:
        self._before = signal.pthread_sigmask(signal.SIG_BLOCK, self._taken)
        return self

    def __exit__(self, *_: object) -> None:
        while signal.sigtimedwait(self._taken, 0.0) is not None:
            pass
        signal.pthread_sigmask(signal.SIG_SETMASK, self._before)

    def wait(self, timeout_s: float) -> signal.Signals | None:
        """The signal that asks to end, or None once a child has ended or the time is up."""
        # An alarm tells that it is: where a process was stopped for longer than it meant to wait (Ctrl-Z),
        # ``signal.sigtimedwait`` returns a signal that nobody sent.
        signal.setitimer(signal.ITIMER_REAL, max(timeout_s, SOON_S))
        try:
            taken = signal.Signals(signal.sigwaitinfo(self._taken).si_signo)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        return None if taken in (signal.SIGCHLD, signal.SIGALRM) else taken
