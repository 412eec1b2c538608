"""The first code of a supervised process, before its module runs; a fresh interpreter runs this module itself."""

from __future__ import annotations

import ctypes
import os
import runpy
import signal
import sys
from collections.abc import Iterable
from typing import NoReturn

from setproctitle import setproctitle

PR_SET_PDEATHSIG = 1
_prctl = ctypes.CDLL(None, use_errno=True).prctl


def become(title: str, module: str, arguments: Iterable[str], parent: int) -> NoReturn:
    """Run a module as ``python -m`` does, as a process that ends with its supervisor and with nobody else's Ctrl-C."""
    # SIGKILL, since a process that hangs while it holds Python's lock handles no other signal.
    _prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    setproctitle(title)
    sys.argv = [module, *arguments]
    code = _run(module)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            code = code or 1
    # Not ``sys.exit``: after a fork the frames below and the exit handlers belong to the supervisor.
    os._exit(code)


def _run(module: str) -> int:
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return (end.code or 0) & 0xFF
        sys.stderr.write(f"{end.code}\n")
        return 1
    except BaseException:  # noqa: BLE001 - whatever it is, it ends this process and belongs in its log
        sys.excepthook(*sys.exc_info())
        return 1
    return 0


if __name__ == "__main__":
    become(sys.argv[2], sys.argv[3], sys.argv[4:], parent=int(sys.argv[1]))
