"""Starts processes, watches them, starts again those that fail, gives up on those that keep failing, ends them all."""

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
from zengrid.processes.log import begin, bound, tail
from zengrid.processes.signals import Signals
from zengrid.processes.spec import ProcessSpec
from zengrid.processes.start import Start, fork

EventKind = Literal["started", "ended", "failed", "gave_up", "hopeless"]
"""``failed``: it will be started again; ``gave_up``: it will not; ``hopeless``: nor would it help."""

KILL_AFTER_S = 3.0
"""How long a process that was asked to end may take. [s]"""
LOG_CHECK_S = 10.0
"""How often the sizes of logs are looked at. [s]"""


class Event(NamedTuple):
    """Something that happened to a process, for whoever shows it."""

    name: str
    kind: EventKind
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
    """set once it was asked to end"""
    code: int | None = None
    """how it ended last: its exit code, or minus the signal that killed it"""


class Supervisor:
    """Looks after processes; ``poll`` does the work whenever its owner calls it. Use it with ``with``.

    A process that exits with 0 has done its work and is not started again. Any other end is a failure.

    Parameters
    ----------
    on_event:
        Told what happens, from within ``start`` and ``poll``.
    start:
        How processes are started: ``zengrid.processes.start.fork`` or ``spawn``.
    now:
        A monotonic clock. [s]
    """

    def __init__(
        self, on_event: Callable[[Event], None], start: Start = fork, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._tell = on_event
        self._start = start
        self._now = now
        self._processes: dict[str, _Process] = {}
        self._restarting = True
        self._logs_due = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    # ---------------------------------------------------------------- what its owner asks

    def start(self, spec: ProcessSpec) -> None:
        """Start a process and look after it from now on."""
        known = self._processes.get(spec.name)
        if known is not None and (known.pid is not None or known.restart_at is not None):
            raise ValueError(f"process = {spec.name}: runs already")
        process = self._processes[spec.name] = _Process(spec)
        self._run(process)

    def stop(self, name: str, within_s: float = KILL_AFTER_S) -> None:
        """Ask a process to end (SIGTERM), and kill it after some time; it is not started again."""
        process = self._processes[name]
        process.restart_at = None
        if process.pid is not None and process.kill_at is None:
            process.kill_at = self._now() + within_s
            self._signal(process, signal.SIGTERM)

    def release(self) -> None:
        """From now on processes may end as they like: none is started again."""
        self._restarting = False
        for process in self._processes.values():
            process.restart_at = None

    def kill(self) -> None:
        """End everything at once and wait for it."""
        for process in self._processes.values():
            process.restart_at = None
            if process.pid is not None:
                self._signal(process, signal.SIGKILL)
        for process in self._processes.values():
            if process.pid is not None:
                os.waitpid(process.pid, 0)
                process.pid = None

    def alive(self, names: Iterable[str] | None = None) -> list[str]:
        """Those (of the given ones) that run, or are about to be started again."""
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
        """How a process ended last: its exit code, or minus the signal that killed it; None while it never did."""
        return self._processes[name].code

    def last_words(self, name: str) -> list[str]:
        """The last lines that a process wrote in its present or last life."""
        process = self._processes[name]
        return [] if process.spec.log is None else tail(process.spec.log, process.log_from)

    # ---------------------------------------------------------------- what it does by itself

    def look_after(
        self, signals: Signals, names: Iterable[str] | None = None, within_s: float = math.inf
    ) -> signal.Signals | None:
        """Look after all processes until none of the given ones is alive, the time is up, or a signal asks to end.

        Returns
        -------
        signal.Signals or None
            The signal, if that is what ended it.
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
        """Take note of processes that ended; start and kill those that are due.

        Call it whenever SIGCHLD has come, or the time that it returned is over. [s]
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
            self._bound_logs()
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
                process.log_from = begin(spec.log)
            process.pid = self._start(spec, (*spec.arguments, *again))
        except (OSError, ValueError) as error:
            self._failed(process, f"cannot be started: {error}", hopeless=process.starts == 1 and _stays(error))
            return
        self._tell(Event(spec.name, "started", f"{spec.name}: started" + (" again" if process.starts > 1 else "")))

    def _ended(self, process: _Process, code: int) -> None:
        spec, now = process.spec, self._now()
        process.pid, process.code = None, code
        if code == 0 or process.kill_at is not None or not self._restarting:
            self._tell(Event(spec.name, "ended", f"{spec.name}: {describe(code)}"))
            return
        users_to_mend = code > 0 and code != EXIT_INTERNAL
        hopeless = users_to_mend and process.starts == 1 and now - process.started < spec.restarts.hopeless_s
        self._failed(process, describe(code), hopeless=hopeless)

    def _failed(self, process: _Process, how: str, *, hopeless: bool) -> None:
        """Start it again after a while, or give it up."""
        name, restarts, failures, now = process.spec.name, process.spec.restarts, process.failures, self._now()
        failures.append(now)
        while failures[0] < now - restarts.window_s:
            failures.popleft()
        if hopeless:
            self._tell(Event(name, "hopeless", f"{name}: {how}"))
            return
        if len(failures) >= restarts.limit:
            often = f"{len(failures)} failures within {restarts.window_s:g} s"
            self._tell(Event(name, "gave_up", f"{name}: {how}, {often}; given up"))
            return
        wait_s = restarts.wait_s(len(failures))
        process.restart_at = now + wait_s
        self._tell(Event(name, "failed", f"{name}: {how}; starting it again in {wait_s:.1f} s"))

    def _signal(self, process: _Process, number: signal.Signals) -> None:
        assert process.pid is not None
        # Its id cannot have passed to another process: that happens only once this one has waited for it.
        os.kill(process.pid, number)

    def _bound_logs(self) -> None:
        for process in self._processes.values():
            with suppress(OSError):  # such as a full disk; it is tried again
                if process.spec.log is not None and bound(process.spec.log):
                    process.log_from = 0


def _stays(error: OSError | ValueError) -> bool:
    """Whether what kept a process from starting stays as it is; room in the system or on the disk may come."""
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
