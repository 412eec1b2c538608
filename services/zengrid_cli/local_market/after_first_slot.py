"""Runs a module once a market has settled its first slot, so that the module does not slow down the start."""

from __future__ import annotations

import argparse
import runpy
import sys
import threading

from zengrid.bus.market_client import MarketClient
from zengrid.command_line.bus_options import add_bus_options
from zengrid.errors import BusError

STATE_INTERVAL_S = 0.2
"""How often the clock is asked whether the market is paused. [s]"""


def wait_for_first_slot(bus: argparse.Namespace) -> None:
    """Wait until a slot is settled, or the market is paused or has ended."""
    settled = threading.Event()
    while True:
        try:
            with MarketClient(bus.run, bus.connect, certs=bus.certs, timeout_s=30.0) as client:
                client.follow(lambda payload: settled.set())
                while not settled.wait(STATE_INTERVAL_S):
                    if client.control("status", homes=False).state in ("paused", "ended"):
                        return
                return
        except BusError:
            continue


def main(module: str, *arguments: str) -> None:
    """Wait for the market that the arguments name, then run the module with them."""
    bus = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_bus_options(bus)
    wait_for_first_slot(bus.parse_known_args(arguments)[0])
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
