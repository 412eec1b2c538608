"""``zengrid health``: checks whether a process in this container is connected to the market, for its supervisor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from zengrid.command_line.bus_options import add_connect_option
from zengrid.command_line.command_parser import CommandParser
from zengrid.errors import BusError

ESTABLISHED = "01"
"""The kernel's code for an established connection."""


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid health",
        description="Check whether a process on this machine, or in this container, is connected to the market: exit "
        "code 0 if it is, 1 if not. It sends nothing, and is cheap enough to run every few seconds.",
        examples=["zengrid health --connect tcp/clock:7447"],
    )
    add_connect_option(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Return 0 if there is a connection to the clock's port, else 1."""
    command_line = parser()
    endpoint = command_line.parse_args(arguments).connect
    port = endpoint.partition("?")[0].rpartition(":")[2]
    if not port.isdecimal():
        command_line.error(f"--connect = {endpoint}: permitted: PROTOCOL/HOST:PORT")
    tables = [Path("/proc/net/tcp"), Path("/proc/net/tcp6")]
    lines = [line for table in tables if table.exists() for line in table.read_text().splitlines()]
    if not connected(lines, int(port)):
        raise BusError(f"no process here is connected to {endpoint}")
    print(f"connected to {endpoint}")
    return 0


def connected(lines: Iterable[str], port: int) -> bool:
    """Whether the kernel's table of connections has one to that port."""
    rows = [line.split() for line in lines]
    return any(len(row) > 3 and row[2].endswith(f":{port:04X}") and row[3] == ESTABLISHED for row in rows)
