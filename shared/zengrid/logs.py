"""What a process tells on stderr: sentences for a person, or structured lines with run, day, slot and agent."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Literal

Level = Literal["debug", "info", "warning", "error"]
LEVELS: tuple[Level, ...] = ("debug", "info", "warning", "error")
FORMS = ("text", "json")
FORM_VARIABLE, LEVEL_VARIABLE = "ZENGRID_LOG", "ZENGRID_LOG_LEVEL"
ORDER = ("time", "level", "service", "run", "day", "slot", "agent", "event")


class _Log:
    """How this process logs; one a process, as stderr is."""

    def __init__(self) -> None:
        self.json = False
        self.least = LEVELS.index("warning")
        self.service = self.prefix = ""
        self.context: dict[str, Any] = {}
        self.logger: Any = None


_log = _Log()


# -------------------------------------------------------------------- the switch


def add_log_options(parser: argparse._ActionsContainer) -> None:
    """Add ``--log`` and ``--log-level``; each can come from the environment instead."""
    parser.add_argument(
        "--log",
        type=_one_of("log", FORMS),
        default=os.environ.get(FORM_VARIABLE) or "text",
        metavar="FORM",
        help=f"text, or json: whatever is told is one JSON object a line (default: %(default)s; "
        f"environment: {FORM_VARIABLE})",
    )
    parser.add_argument(
        "--log-level",
        type=_one_of("log level", LEVELS),
        default=os.environ.get(LEVEL_VARIABLE) or "warning",
        metavar="LEVEL",
        help=f"least level of what is logged: {', '.join(LEVELS)} (default: %(default)s; "
        f"environment: {LEVEL_VARIABLE})",
    )


def _one_of(name: str, permitted: Sequence[str]) -> Callable[[str], str]:
    """Unlike the ``choices`` of argparse it checks defaults, too, which may come from the environment."""

    def parse(text: str) -> str:
        if text not in permitted:
            raise argparse.ArgumentTypeError(f"{name} = {text}: permitted: {', '.join(permitted)}")
        return text

    return parse


def begin(service: str, options: argparse.Namespace, *, prefix: str | None = None, **context: Any) -> None:
    """Log as the command line asks, on the present stderr.

    Parameters
    ----------
    service:
        Part of every structured line.
    options:
        With ``log`` and ``log_level``, see ``add_log_options``.
    prefix:
        Begins every sentence for a person; by default ``zengrid SERVICE: ``.
    context:
        Fields of every structured line, such as the run.
    """
    _log.service, _log.prefix = service, f"zengrid {service}: " if prefix is None else prefix
    _log.json, _log.least = options.log == "json", LEVELS.index(options.log_level)
    _log.context = {"service": service, **context}
    _log.logger = None
    sys.excepthook = _crashed
    threading.excepthook = _crashed_thread
    if _log.json or wants("info"):
        # Loading structlog takes a while, which nobody shall wait for in the middle of a slot.
        _log.logger = _structured()


def export(options: argparse.Namespace) -> None:
    """Let all processes that are started from here log in the same way."""
    os.environ[FORM_VARIABLE], os.environ[LEVEL_VARIABLE] = options.log, options.log_level


def bind(**context: Any) -> None:
    """Further fields of every structured line."""
    _log.context |= context


def is_json() -> bool:
    """Whether each line is a JSON object."""
    return _log.json


def line(event: str) -> str:
    """An event of this process as a structured line, for a file that others go on with."""
    import structlog

    return str(_structured(structlog.ReturnLogger()).info(event, **_log.context))


def wants(level: Level) -> bool:
    """Whether events of this level are logged; ask before gathering what costs time."""
    return LEVELS.index(level) >= _log.least


# -------------------------------------------------------------------- what is told


def say(text: str, level: Level = "info", **fields: Any) -> None:
    """Tell whoever started this process something that is told at every level, such as where it listens."""
    if _log.json:
        _write(level, text, fields)
    else:
        _sentence(f"{_log.prefix}{text}")


def fail(error: object) -> None:
    """Say why this process ends."""
    if _log.json:
        _write("error", str(error), {})
    else:
        _sentence(f"zengrid {_log.service}: {error}")


def unexpected(where: str, error: Exception) -> None:
    """Tell of an error that nobody has foreseen, and that this process goes on after."""
    text = f"unexpected error {where}: {type(error).__name__}: {error}"
    trace = "".join(traceback.format_exception(error))
    if _log.json:
        _write("error", text, {"exception": trace})
    else:
        _sentence(f"{_log.prefix}{text}\n{trace.rstrip()}")


def note(level: Level, event: str, **fields: Any) -> None:
    """A structured line, where events of this level are logged."""
    if wants(level):
        _write(level, event, fields)


def printable(text: str) -> str:
    """Lines as they may be shown: what else a terminal would obey, or a reader not see, as ``\\u001b``."""
    return text if text.isprintable() else "\n".join(map(_escaped, text.split("\n")))


def _escaped(line: str) -> str:
    return line if line.isprintable() else "".join(each if each.isprintable() else _code(each) for each in line)


def _code(character: str) -> str:
    """As JSON writes it, which is none of its own where the text is JSON."""
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{high:02x}{low:02x}" for high, low in zip(units[::2], units[1::2], strict=True))


def _sentence(text: str) -> None:
    # Further lines are indented: none can pass for one of its own.
    first, *more = printable(text).split("\n")
    sys.stderr.write("\n".join([first, *(line if line.startswith("  ") else f"  {line}" for line in more)]) + "\n")
    sys.stderr.flush()


def _write(level: Level, event: str, fields: dict[str, Any]) -> None:
    if _log.logger is None:
        _log.logger = _structured()
    getattr(_log.logger, level)(event, **{**_log.context, **fields})


def _structured(target: Any = None) -> Any:
    # Loaded where it is switched on: it would take longer than all else that an agent loads.
    import structlog

    def ordered(logger: Any, method: str, fields: Any) -> Any:
        return {name: fields[name] for name in ORDER if name in fields} | dict(fields)

    def shown(logger: Any, method: str, line: Any) -> str:
        return _escaped(line)  # in both forms all that cannot be printed has come with a value

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
    if not issubclass(it.exc_type, SystemExit):  # which ends a thread, and is no error
        _crashed(it.exc_type, it.exc_value, it.exc_traceback)
