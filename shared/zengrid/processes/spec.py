"""What a supervisor is told of a process: which module it runs, where it writes, how often it may fail."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Restarts:
    """How a process that fails is started again.

    Parameters
    ----------
    limit:
        Failures within ``window_s`` after which it is given up.
    window_s:
        Failures longer ago than this are forgiven. [s]
    first_s, longest_s:
        Wait before the first restart; it doubles with each failure, up to the longest. [s]
    hopeless_s:
        An error within this time of the very first start is final: it would only happen again. Errors of the program
        itself (``EXIT_INTERNAL``) and signals are not meant. [s]
    """

    limit: int = 6
    window_s: float = 60.0
    first_s: float = 0.1
    longest_s: float = 5.0
    hopeless_s: float = 0.0

    def wait_s(self, failures: int) -> float:
        """How long to wait after so many failures in a row. [s]"""
        return min(self.longest_s, self.first_s * 2.0 ** min(failures - 1, 60))


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process.

    Parameters
    ----------
    name:
        What the supervisor, its events and the log file call it.
    module, arguments:
        Run as ``python -m module arguments``.
    title:
        What ``ps`` shows; by default the name.
    again:
        Further arguments whenever it is started again.
    log:
        File for its output; None leaves it the supervisor's own.
    environment:
        Variables beside those of the supervisor.
    restarts:
        When it is started again, and when it is given up.
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    title: str = ""
    again: tuple[str, ...] = ()
    log: Path | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    restarts: Restarts = Restarts()
