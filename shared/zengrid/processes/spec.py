"""The description of a process for the supervisor: its module, its log file, and how often it may fail."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Restarts:
    """How a process that fails is restarted.

    Parameters
    ----------
    limit:
        Number of failures within ``window_s`` after which the supervisor gives up.
    window_s:
        Failures longer ago than this do not count. [s]
    first_s, longest_s:
        Wait before the first restart; it doubles with each failure, up to the longest. [s]
    unrecoverable_within_s:
        After an error within this time of the first start the process is not restarted, since the error would happen
        again. Internal errors (``EXIT_INTERNAL``) and signals do not count. [s]
    """

    limit: int = 6
    window_s: float = 60.0
    first_s: float = 0.1
    longest_s: float = 5.0
    unrecoverable_within_s: float = 0.0

    def wait_s(self, failures: int) -> float:
        """The wait after this number of failures in a row. [s]"""
        return min(self.longest_s, self.first_s * 2.0 ** min(failures - 1, 60))


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process.

    Parameters
    ----------
    name:
        Name in the supervisor's requests and events.
    module, arguments:
        Run as ``python -m module arguments``.
    title:
        Title in ``ps``; by default the name.
    again:
        Further arguments of every restart.
    log:
        File of its output; None: the supervisor's own output.
    environment:
        Environment variables in addition to those of the supervisor.
    restarts:
        When it is restarted, and when not any more.
    """

    name: str
    module: str
    arguments: tuple[str, ...] = ()
    title: str = ""
    again: tuple[str, ...] = ()
    log: Path | None = None
    environment: Mapping[str, str] = field(default_factory=dict)
    restarts: Restarts = Restarts()
