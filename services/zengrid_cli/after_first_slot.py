"""Runs a module once a market has settled its first slot: what starts later does not hold up its start."""

from __future__ import annotations

import argparse
import runpy
import sys
import threading

from zengrid.bus.market_client import MarketClient
from zengrid.bus.options import add_bus_options
from zengrid.errors import BusError

LOOK_S = 0.2
"""How often a market that stands still is asked for its state. [s]"""


def wait(bus: argparse.Namespace) -> None:
    """Wait until a slot is settled, or the market stands still until somebody tells it to go on."""
    settled = threading.Event()
    while True:
        try:
            with MarketClient(bus.run, bus.connect, certs=bus.certs, timeout_s=30.0) as client:
                client.follow(lambda payload: settled.set())
                while not settled.wait(LOOK_S):
                    if client.control("status", homes=False).state in ("paused", "ended"):
                        return
                return
        except BusError:
            continue


def main(module: str, *arguments: str) -> None:
    """Wait for the market that the arguments name, then be that module."""
    bus = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add_bus_options(bus)
    wait(bus.parse_known_args(arguments)[0])
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
