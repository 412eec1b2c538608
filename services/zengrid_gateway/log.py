"""What the HTTP server logs, as structured lines where these are asked for."""

from __future__ import annotations

import logging
from typing import Any, cast

from uvicorn.config import LOGGING_CONFIG

from zengrid import logs

_FORMAT = logging.Formatter()


class Structured(logging.Handler):
    """Hands records of ``logging`` on."""

    def emit(self, record: logging.LogRecord) -> None:
        """One record."""
        level = cast(logs.Level, record.levelname.lower().replace("critical", "error"))
        trace = {} if record.exc_info is None else {"exception": _FORMAT.formatException(record.exc_info)}
        logs.log_event(level, record.getMessage(), logger=record.name, **trace)


class Printable(logging.Filter):
    """Writes what a terminal would obey in what came with a request as ``\\u001b`` and the like."""

    def filter(self, record: logging.LogRecord) -> bool:
        """All pass."""
        if isinstance(record.args, tuple):
            record.args = tuple(logs.printable(each) if isinstance(each, str) else each for each in record.args)
        if record.exc_info is not None:
            record.exc_text = logs.printable(_FORMAT.formatException(record.exc_info))
        return True


def log_config() -> dict[str, Any]:
    """How uvicorn logs."""
    if not logs.is_json():
        handlers = {name: {**handler, "filters": ["printable"]} for name, handler in LOGGING_CONFIG["handlers"].items()}
        return {**LOGGING_CONFIG, "filters": {"printable": {"()": Printable}}, "handlers": handlers}
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "handlers": {"structured": {"()": Structured}},
        "root": {"handlers": ["structured"], "level": "WARNING"},
    }
