"""The errors zengrid raises on purpose: each names the thing, its value and what is permitted."""

from __future__ import annotations

BRIEF = 100
"""Longest value that an error shows. [characters]"""


def brief(value: object) -> str:
    """A value from outside as an error shows it: as text, and not all of it where it is long."""
    text = str(value)
    return text if len(text) <= BRIEF else f"{text[: BRIEF - 3]}..."


EXIT_FAILED = 1
"""Exit code of a process that could not do its work, for a reason that the user can correct."""
EXIT_USAGE = 2
"""Exit code after a wrong command line."""
EXIT_INTERNAL = 70
"""Exit code of a process that met an error of its own: starting it again may help."""
EXIT_INTERRUPTED = 130
"""Exit code after Ctrl-C."""


class ZengridError(Exception):
    """Base of every error that a user of zengrid can mend."""


class ScenarioError(ZengridError):
    """A scenario or its data is wrong: names the field or file position, the value and the permitted range."""


class SettlementError(ZengridError):
    """A slot cannot be settled: a number is not finite."""


class PolicyError(ZengridError):
    """A policy cannot be used: unknown name, bad argument, or a file that does not fit the market."""


class JournalError(ZengridError):
    """The journal cannot be read or written, or holds something else than asked for."""


class JournalUnavailableError(JournalError):
    """The journal cannot be used now (disk full, database away, another writer): nothing is lost, later it may be."""


class WireError(ZengridError):
    """A message does not follow the protocol."""


class BusError(ZengridError):
    """A Zenoh session cannot be opened, or nobody answers on it."""


class SecurityError(ZengridError):
    """A certificate or key is missing, no longer valid, or not what it should be."""


class RefusedError(ZengridError):
    """The other side answered, and said no: the message says why, ``reason`` in one word (see ``RefusalReason``)."""

    def __init__(self, message: str, reason: str = "invalid") -> None:
        super().__init__(message)
        self.reason = reason
