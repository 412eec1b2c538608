"""Options that say what a process logs, and in which form."""

from __future__ import annotations

import argparse

from zengrid.command_line.command_parser import EnvironmentOption
from zengrid.logs import FORM_VARIABLE, FORMS, LEVEL_VARIABLE, LEVELS


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--log`` and ``--log-level``."""
    group = parser.add_argument_group("logs")
    group.add_argument(
        "--log",
        action=EnvironmentOption,
        environment=FORM_VARIABLE,
        choices=FORMS,
        default="text",
        help="text: sentences for a person; json: one JSON object per line",
    )
    group.add_argument(
        "--log-level",
        action=EnvironmentOption,
        environment=LEVEL_VARIABLE,
        choices=LEVELS,
        default="warning",
        help="lowest level that is logged",
    )
