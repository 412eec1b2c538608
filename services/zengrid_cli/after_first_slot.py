"""Runs a module once a market has settled its first slot: what starts later does not hold up its start."""

from __future__ import annotations

import runpy
import sys
import threading

from zengrid.bus.client import Client
from zengrid.errors import BusError

LOOK_S = 0.2
"""How often a market that stands still is asked for its state. [s]"""


def wait(endpoint: str, run: str) -> None:
    """Wait until a slot is settled, or the market stands still until somebody tells it to go on."""
    settled = threading.Event()
    while True:
        try:
            with Client(run, endpoint, timeout_s=30.0) as client:
                client.follow(lambda payload: settled.set())
                while not settled.wait(LOOK_S):
                    if client.control("status", homes=False).state in ("paused", "ended"):
                        return
                return
        except BusError:
            continue


def main(endpoint: str, run: str, module: str, *arguments: str) -> None:
    """Wait, then be that module."""
    wait(endpoint, run)
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
