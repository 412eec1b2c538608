"""Command-line options that every process on the bus shares; each can come from the environment instead."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from zengrid.bus.keys import DEFAULT_RUN
from zengrid.bus.zenoh_session import DEFAULT_ENDPOINT


def add_bus_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--connect``, ``--run`` and ``--certs``."""
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=os.environ.get("ZENGRID_CONNECT", DEFAULT_ENDPOINT),
        help="where the market's clock listens (default: %(default)s; environment: ZENGRID_CONNECT)",
    )
    parser.add_argument(
        "--run",
        metavar="NAME",
        default=os.environ.get("ZENGRID_RUN", DEFAULT_RUN),
        help="name of the market (default: %(default)s; environment: ZENGRID_RUN)",
    )
    add_certs_option(parser)


def add_certs_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--certs``: the one setting that turns on certificates and the access list."""
    given = os.environ.get("ZENGRID_CERTS")
    parser.add_argument(
        "--certs",
        type=Path,
        metavar="FOLDER",
        default=Path(given) if given else None,
        help="certificates made by zengrid certs: links are encrypted, and each side proves who it is "
        "(environment: ZENGRID_CERTS)",
    )
