"""Runs a command of ``zengrid`` in this process, as the command line does."""

from __future__ import annotations

import io
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

from zengrid_cli.__main__ import main


class CommandResult(NamedTuple):
    """What a command has printed, and its exit code."""

    exit_code: int
    stdout: str
    stderr: str


def run_zengrid(*words: str) -> CommandResult:
    """Run ``zengrid`` with these words."""
    stdout, stderr = io.StringIO(), io.StringIO()
    with redirect_stdout(stdout), redirect_stderr(stderr):
        code = main(words)
    return CommandResult(code, stdout.getvalue(), stderr.getvalue())
