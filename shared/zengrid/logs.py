"""Messages of a process on stderr: sentences for a person, or structured lines with run, day, slot and agent."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import traceback
from types import TracebackType
from typing import Any, Literal

Level = Literal["debug", "info", "warning", "error"]
LEVELS: tuple[Level, ...] = ("debug", "info", "warning", "error")
FORMS = ("text", "json")
FORM_VARIABLE, LEVEL_VARIABLE = "ZENGRID_LOG", "ZENGRID_LOG_LEVEL"
ORDER = ("time", "level", "service", "run", "day", "slot", "agent", "event")


class _Log:
    """How this process logs; there is one per process, as there is one stderr."""

    def __init__(self) -> None:
        self.json = False
        self.least = LEVELS.index("warning")
        self.service = self.prefix = ""
        self.context: dict[str, Any] = {}
        self.logger: Any = None


_log = _Log()


# -------------------------------------------------------------------- settings


def set_service(name: str) -> None:
    """Set the name of the command, which begins every sentence."""
    _log.service, _log.prefix = name, f"zengrid {name}: "


def configure(service: str, options: argparse.Namespace, *, prefix: str | None = None, **context: Any) -> None:
    """Log as the command line asks, to the present stderr.

    Parameters
    ----------
    service:
        Name of the service in every structured line.
    options:
        With ``log`` and ``log_level``, see ``zengrid.command_line.log_options``.
    prefix:
        Beginning of every sentence for a person; by default ``zengrid SERVICE: ``.
    context:
        Fields of every structured line, such as the run.
    """
    _log.service, _log.prefix = service, f"zengrid {service}: " if prefix is None else prefix
    _log.json, _log.least = options.log == "json", LEVELS.index(options.log_level)
    _log.context = {"service": service, **context}
    _log.logger = None
    sys.excepthook = _crashed
    threading.excepthook = _crashed_thread
    if _log.json or is_enabled("info"):
        # Loading structlog takes a while, which must not happen in the middle of a slot.
        _log.logger = _structured()


def export_settings(options: argparse.Namespace) -> None:
    """Let all processes that are started from here log in the same way."""
    os.environ[FORM_VARIABLE], os.environ[LEVEL_VARIABLE] = options.log, options.log_level


def add_context(**context: Any) -> None:
    """Add fields to every structured line."""
    _log.context |= context


def is_json() -> bool:
    """Whether each line is a JSON object."""
    return _log.json


def format_line(event: str) -> str:
    """Format an event of this process as a structured line, for the log file of another process."""
    import structlog

    return str(_structured(structlog.ReturnLogger()).info(event, **_log.context))


def is_enabled(level: Level) -> bool:
    """Whether events of this level are logged; check it before you compute fields that take time."""
    return LEVELS.index(level) >= _log.least


# -------------------------------------------------------------------- messages


def print_message(text: str, level: Level = "info", **fields: Any) -> None:
    """Print a message that is shown at every level, such as where the process listens."""
    if _log.json:
        _write(level, text, fields)
    else:
        _sentence(f"{_log.prefix}{text}")


def print_error(error: object) -> None:
    """Print why this process ends."""
    if _log.json:
        _write("error", str(error), {})
    else:
        _sentence(f"zengrid {_log.service}: {error}")


def print_unexpected(where: str, error: Exception) -> None:
    """Print an unexpected error after which this process continues, with its traceback."""
    text = f"unexpected error {where}: {type(error).__name__}: {error}"
    trace = "".join(traceback.format_exception(error))
    if _log.json:
        _write("error", text, {"exception": trace})
    else:
        _sentence(f"{_log.prefix}{text}\n{trace.rstrip()}")


def log_event(level: Level, event: str, **fields: Any) -> None:
    """Log an event as a structured line, if events of this level are logged."""
    if is_enabled(level):
        _write(level, event, fields)


def printable(text: str) -> str:
    """Escape what a terminal would obey or a reader would not see, as in ``\\u001b``; line breaks stay."""
    return text if text.isprintable() else "\n".join(map(_escaped, text.split("\n")))


def _escaped(line: str) -> str:
    return line if line.isprintable() else "".join(each if each.isprintable() else _code(each) for each in line)


def _code(character: str) -> str:
    """A character in the notation of JSON, so that text that is JSON stays JSON."""
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{high:02x}{low:02x}" for high, low in zip(units[::2], units[1::2], strict=True))


def _sentence(text: str) -> None:
    # Further lines are indented, so that none looks like a message of its own.
    first, *more = printable(text).split("\n")
    sys.stderr.write("\n".join([first, *(line if line.startswith("  ") else f"  {line}" for line in more)]) + "\n")
    sys.stderr.flush()


def _write(level: Level, event: str, fields: dict[str, Any]) -> None:
    if _log.logger is None:
        _log.logger = _structured()
    getattr(_log.logger, level)(event, **{**_log.context, **fields})


def _structured(target: Any = None) -> Any:
    # Loaded only where it is used: it takes longer than all other imports of an agent.
    import structlog

    def ordered(logger: Any, method: str, fields: Any) -> Any:
        return {name: fields[name] for name in ORDER if name in fields} | dict(fields)

    def shown(logger: Any, method: str, line: Any) -> str:
        return _escaped(line)  # in both forms only values contain unprintable characters

    form = (
        structlog.processors.JSONRenderer(ensure_ascii=False)
        if _log.json
        else structlog.processors.LogfmtRenderer(bool_as_flag=False)
    )
    stamp = structlog.processors.TimeStamper(fmt="iso", utc=True, key="time")
    return structlog.wrap_logger(
        target or structlog.WriteLogger(sys.stderr),
        processors=[structlog.processors.add_log_level, stamp, ordered, form, shown],
        wrapper_class=structlog.make_filtering_bound_logger(0),
    )


def _crashed(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
    lines = traceback.format_exception(kind, error, trace)
    if _log.json:
        _write("error", lines[-1].strip(), {"exception": "".join(lines)})
    else:
        sys.stderr.write(printable("".join(lines)))


def _crashed_thread(it: threading.ExceptHookArgs) -> None:
    if not issubclass(it.exc_type, SystemExit):  # SystemExit ends a thread, and is no error
        _crashed(it.exc_type, it.exc_value, it.exc_traceback)
