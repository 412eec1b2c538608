"""Options of every process that connects to a market."""

from __future__ import annotations

import argparse
from pathlib import Path

from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.keys import DEFAULT_RUN
from zengrid.command_line.command_parser import EnvironmentOption


def add_bus_options(parser: argparse._ActionsContainer) -> None:
    """Add ``--connect``, ``--run`` and ``--certs``."""
    add_connect_option(parser)
    add_run_option(parser)
    add_certs_option(parser)


def add_connect_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--connect``: the endpoint of the clock."""
    parser.add_argument(
        "--connect",
        action=EnvironmentOption,
        environment="ZENGRID_CONNECT",
        metavar="ENDPOINT",
        default=DEFAULT_ENDPOINT,
        help="where the market's clock or router listens",
    )


def add_listen_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--listen`` and ``--insecure``: where the clock can be reached."""
    parser.add_argument(
        "--listen",
        action=EnvironmentOption,
        environment="ZENGRID_LISTEN",
        metavar="ENDPOINT",
        default=DEFAULT_ENDPOINT,
        help="where agents connect, PROTOCOL/HOST:PORT; zengrid up also takes auto for any free port",
    )
    parser.add_argument(
        "--insecure", action="store_true", help="allow connections from other machines without authentication"
    )


def add_run_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--run``: the name of the market."""
    parser.add_argument(
        "--run",
        action=EnvironmentOption,
        environment="ZENGRID_RUN",
        metavar="NAME",
        default=DEFAULT_RUN,
        help="name of the market",
    )


def add_certs_option(parser: argparse._ActionsContainer) -> None:
    """Add ``--certs``: the folder of certificates, which turns on encryption and the access list."""
    parser.add_argument(
        "--certs",
        action=EnvironmentOption,
        environment="ZENGRID_CERTS",
        type=Path,
        metavar="FOLDER",
        help="certificates made by zengrid certs: connections are encrypted, and both sides prove who they are",
    )
