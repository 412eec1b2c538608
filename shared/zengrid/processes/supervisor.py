"""Starts processes, restarts those that fail, gives up on those that keep failing, and ends them all."""

from __future__ import annotations

import errno
import math
import os
import signal
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Self

from zengrid.errors import EXIT_INTERNAL
from zengrid.processes.process_log import limit_log, read_last_lines, start_log
from zengrid.processes.signals import Signals
from zengrid.processes.spec import ProcessSpec
from zengrid.processes.start import Start, fork

ProcessEventKind = Literal["started", "ended", "failed", "gave_up", "unrecoverable"]
"""``failed``: it will be restarted; ``gave_up``: it failed too often; ``unrecoverable``: a restart would not help."""

KILL_AFTER_S = 3.0
"""How long a process may take to end after SIGTERM. [s]"""
LOG_CHECK_S = 10.0
"""How often the sizes of logs are checked. [s]"""


class ProcessEvent(NamedTuple):
    """An event of a process, with a text for a person."""

    name: str
    kind: ProcessEventKind
    text: str


@dataclass(slots=True)
class _Process:
    spec: ProcessSpec
    pid: int | None = None
    """None while it does not run"""
    starts: int = 0
    started: float = 0.0
    log_from: int = 0
    failures: deque[float] = field(default_factory=deque)
    restart_at: float | None = None
    kill_at: float | None = None
    """set when it was sent SIGTERM"""
    code: int | None = None
    """how it ended last: its exit code, or minus the signal that killed it"""


class Supervisor:
    """Starts and supervises processes; ``poll`` does the work whenever its owner calls it. Use it with ``with``.

    A process that exits with 0 has done its work and is not started again. Any other end is a failure.

    Parameters
    ----------
    on_event:
        Called with each event, from within ``start`` and ``poll``.
    start:
        How processes are started: ``zengrid.processes.start.fork`` or ``spawn``.
    now:
        A monotonic clock. [s]
    """

    def __init__(
        self, on_event: Callable[[ProcessEvent], None], start: Start = fork, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._on_event = on_event
        self._start = start
        self._now = now
        self._processes: dict[str, _Process] = {}
        self._restarting = True
        self._logs_due = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    # ---------------------------------------------------------------- requests of the owner

    def start(self, spec: ProcessSpec) -> None:
        """Start a process and supervise it from now on."""
        known = self._processes.get(spec.name)
        if known is not None and (known.pid is not None or known.restart_at is not None):
            raise ValueError(f"process = {spec.name}: runs already")
        process = self._processes[spec.name] = _Process(spec)
        self._run(process)

    def stop(self, name: str, within_s: float = KILL_AFTER_S) -> None:
        """Send SIGTERM to a process, and SIGKILL after some time; it is not restarted."""
        process = self._processes[name]
        process.restart_at = None
        if process.pid is not None and process.kill_at is None:
            process.kill_at = self._now() + within_s
            self._signal(process, signal.SIGTERM)

    def stop_restarting(self) -> None:
        """Restart no process from now on."""
        self._restarting = False
        for process in self._processes.values():
            process.restart_at = None

    def kill(self) -> None:
        """Kill all processes and wait for their end."""
        for process in self._processes.values():
            process.restart_at = None
            if process.pid is not None:
                self._signal(process, signal.SIGKILL)
        for process in self._processes.values():
            if process.pid is not None:
                os.waitpid(process.pid, 0)
                process.pid = None

    def alive(self, names: Iterable[str] | None = None) -> list[str]:
        """The names (of the given ones) of processes that run or will be restarted."""
        chosen = self._processes if names is None else names
        return [
            name
            for name in chosen
            if (it := self._processes.get(name)) is not None and (it.pid is not None or it.restart_at is not None)
        ]

    def pid(self, name: str) -> int | None:
        """The process id, while it runs."""
        return self._processes[name].pid

    def code(self, name: str) -> int | None:
        """How a process last ended: its exit code, or minus the signal that killed it; None if it has not ended yet."""
        return self._processes[name].code

    def last_log_lines(self, name: str) -> list[str]:
        """The last lines of a process since its latest start."""
        process = self._processes[name]
        return [] if process.spec.log is None else read_last_lines(process.spec.log, process.log_from)

    # ---------------------------------------------------------------- supervision

    def supervise(
        self, signals: Signals, names: Iterable[str] | None = None, within_s: float = math.inf
    ) -> signal.Signals | None:
        """Supervise all processes until none of the given ones is alive, the time is up, or a signal asks to end.

        Returns
        -------
        signal.Signals or None
            The signal, if one ended it.
        """
        until = self._now() + within_s
        while True:
            wait_s = self.poll()
            left_s = until - self._now()
            if not self.alive(names) or left_s <= 0:
                return None
            if (asked := signals.wait(min(wait_s, left_s))) is not None:
                return asked

    def poll(self) -> float:
        """Handle processes that have ended; start and kill those that are due.

        Call it after each SIGCHLD, and after the time that it returns. [s]
        """
        for process in list(self._processes.values()):
            if process.pid is not None:
                pid, status = os.waitpid(process.pid, os.WNOHANG)
                if pid:
                    self._ended(process, os.waitstatus_to_exitcode(status))
        now = self._now()
        for process in list(self._processes.values()):
            if process.restart_at is not None and process.restart_at <= now:
                self._run(process)
            if process.pid is not None and process.kill_at is not None and process.kill_at <= now:
                process.kill_at = math.inf
                self._signal(process, signal.SIGKILL)
        if now >= self._logs_due:
            self._limit_logs()
            self._logs_due = now + LOG_CHECK_S
        due = [self._logs_due]
        for process in self._processes.values():
            due += [at for at in (process.restart_at, process.kill_at if process.pid else None) if at is not None]
        return max(min(due) - self._now(), 0.0)

    def _run(self, process: _Process) -> None:
        spec = process.spec
        process.restart_at = process.kill_at = None
        process.started = self._now()
        again = spec.again if process.starts else ()
        process.starts += 1
        try:
            if spec.log is not None:
                process.log_from = start_log(spec.log)
            process.pid = self._start(spec, (*spec.arguments, *again))
        except (OSError, ValueError) as error:
            self._failed(
                process, f"cannot be started: {error}", unrecoverable=process.starts == 1 and _is_lasting(error)
            )
            return
        self._on_event(
            ProcessEvent(spec.name, "started", f"{spec.name}: started" + (" again" if process.starts > 1 else ""))
        )

    def _ended(self, process: _Process, code: int) -> None:
        spec, now = process.spec, self._now()
        process.pid, process.code = None, code
        if code == 0 or process.kill_at is not None or not self._restarting:
            self._on_event(ProcessEvent(spec.name, "ended", f"{spec.name}: {describe(code)}"))
            return
        user_error = code > 0 and code != EXIT_INTERNAL
        unrecoverable = (
            user_error and process.starts == 1 and now - process.started < spec.restarts.unrecoverable_within_s
        )
        self._failed(process, describe(code), unrecoverable=unrecoverable)

    def _failed(self, process: _Process, how: str, *, unrecoverable: bool) -> None:
        """Restart a process after a wait, or give up."""
        name, restarts, failures, now = process.spec.name, process.spec.restarts, process.failures, self._now()
        failures.append(now)
        while failures[0] < now - restarts.window_s:
            failures.popleft()
        if unrecoverable:
            self._on_event(ProcessEvent(name, "unrecoverable", f"{name}: {how}"))
            return
        if len(failures) >= restarts.limit:
            often = f"{len(failures)} failures within {restarts.window_s:g} s"
            self._on_event(ProcessEvent(name, "gave_up", f"{name}: {how}, {often}; given up"))
            return
        wait_s = restarts.wait_s(len(failures))
        process.restart_at = now + wait_s
        self._on_event(ProcessEvent(name, "failed", f"{name}: {how}; starting it again in {wait_s:.1f} s"))

    def _signal(self, process: _Process, number: signal.Signals) -> None:
        assert process.pid is not None
        # No other process can have this id: it is free only after this process has waited for it.
        os.kill(process.pid, number)

    def _limit_logs(self) -> None:
        for process in self._processes.values():
            with suppress(OSError):  # such as a full disk; the next check tries again
                if process.spec.log is not None and limit_log(process.spec.log):
                    process.log_from = 0


def _is_lasting(error: OSError | ValueError) -> bool:
    """Whether a process cannot be started later either; missing memory or disk space may become free."""
    lasting = (ValueError, FileNotFoundError, NotADirectoryError, PermissionError)
    return isinstance(error, lasting) or error.errno == errno.E2BIG


def describe(code: int) -> str:
    """``exit code 1``, or the signal that killed it."""
    if code == 0:
        return "done"
    if code > 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"
