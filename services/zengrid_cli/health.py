"""``zengrid health``: whether the process of this container holds its connection to the market, for its supervisor."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

ESTABLISHED = "01"
"""As the kernel writes the state of a connection."""


def main(arguments: Sequence[str]) -> int:
    """Exit code 0 where there is a connection to the clock's port, 1 where there is none."""
    it = argparse.ArgumentParser(
        prog="zengrid health",
        description="Whether a process on this machine, or in this container, is connected to the market. Loads "
        "nothing and sends nothing, so that it can be asked every few seconds.",
    )
    it.add_argument(
        "--connect",
        metavar="ENDPOINT",
        default=os.environ.get("ZENGRID_CONNECT", "tcp/127.0.0.1:7447"),
        help="where the market's clock or router listens (default: %(default)s; environment: ZENGRID_CONNECT)",
    )
    endpoint = it.parse_args(arguments).connect
    port = endpoint.partition("?")[0].rpartition(":")[2]
    if not port.isdecimal():
        print(f"zengrid health: endpoint = {endpoint}: permitted: PROTOCOL/HOST:PORT", file=sys.stderr)
        return 2
    tables = [Path("/proc/net/tcp"), Path("/proc/net/tcp6")]
    lines = [line for table in tables if table.exists() for line in table.read_text().splitlines()]
    if connected(lines, int(port)):
        print(f"connected to {endpoint}")
        return 0
    print(f"zengrid health: nothing here is connected to {endpoint}", file=sys.stderr)
    return 1


def connected(lines: Iterable[str], port: int) -> bool:
    """Whether a table of the kernel's connections has one to that port."""
    rows = [line.split() for line in lines]
    return any(len(row) > 3 and row[2].endswith(f":{port:04X}") and row[3] == ESTABLISHED for row in rows)
