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
        logs.note(level, record.getMessage(), logger=record.name, **trace)


def log_config() -> dict[str, Any]:
    """How uvicorn logs."""
    if not logs.is_json():
        return LOGGING_CONFIG
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "handlers": {"structured": {"()": Structured}},
        "root": {"handlers": ["structured"], "level": "WARNING"},
    }
