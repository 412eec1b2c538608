"""Two ways to start a process: a fork of the supervisor, which has loaded everything, or a fresh interpreter."""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence

from zengrid.processes.process_log import PRIVATE
from zengrid.processes.spec import ProcessSpec

Start = Callable[[ProcessSpec, Sequence[str]], int]
"""Starts a process with these arguments and returns its id.

Raises OSError if the system has no memory for it or does not accept the arguments; ValueError if an argument or an
environment variable holds a text that cannot be passed to a process.
"""

_STDIN, _STDOUT, _STDERR = 0, 1, 2
_APPEND = os.O_WRONLY | os.O_CREAT | os.O_APPEND


def fork(spec: ProcessSpec, arguments: Sequence[str]) -> int:
    """Start a process as a copy of this one: in a few milliseconds, with shared memory of all imported modules.

    Call it only in a process without threads that has opened no Zenoh session: neither survives a fork. Call it, like
    ``spawn``, only from the main thread: the new process ends with the thread that started it.
    """
    from zengrid.processes.child import become

    parent = os.getpid()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        return pid
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        _redirect(os.open(os.devnull, os.O_RDONLY), [_STDIN])
        if spec.log is not None:
            _redirect(os.open(spec.log, _APPEND, PRIVATE), [_STDOUT, _STDERR])
        # Do not use the supervisor's streams: they may be replaced, or hold text that is not written yet.
        sys.stdin, sys.stdout, sys.stderr = open(_STDIN), open(_STDOUT, "w", 1), open(_STDERR, "w", 1)  # noqa: SIM115
        os.environ.update(spec.environment)
        become(spec.title or spec.name, spec.module, arguments, parent)
    except BaseException:  # noqa: BLE001 - no exception may pass this point
        traceback.print_exc()
    finally:
        # Whatever fails above, this copy must never continue as a second supervisor.
        os._exit(1)


def _redirect(source: int, targets: Iterable[int]) -> None:
    for target in targets:
        os.dup2(source, target)
    os.close(source)


def spawn(spec: ProcessSpec, arguments: Sequence[str]) -> int:
    """Start a process in a fresh interpreter: slower by the time of its imports, and possible from any process."""
    actions: list[tuple[int, ...] | tuple[int, int, str, int, int]] = [
        (os.POSIX_SPAWN_OPEN, _STDIN, os.devnull, os.O_RDONLY, 0)
    ]
    if spec.log is not None:
        actions += [
            (os.POSIX_SPAWN_OPEN, _STDOUT, str(spec.log), _APPEND, PRIVATE),
            (os.POSIX_SPAWN_DUP2, _STDOUT, _STDERR),
        ]
    title = spec.title or spec.name
    command = [sys.executable, "-m", "zengrid.processes.child", str(os.getpid()), title, spec.module, *arguments]
    return os.posix_spawn(
        sys.executable,
        command,
        {**os.environ, **spec.environment},
        file_actions=actions,
        setsid=True,
        setsigmask=(),
        setsigdef=(signal.SIGINT, signal.SIGTERM),
    )
