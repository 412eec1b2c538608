"""``zengrid top``: watch a running market from anywhere; also what ``zengrid up`` shows."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from zengrid.bus.options import add_bus_options

if TYPE_CHECKING:
    from zengrid_cli.watch import Watch

FRAME_S = 0.2
START_LOOK_S = 0.1
LINE_S = 5.0
"""A market that is slower than a day in this time gets a line so often. [s]"""
SHORTEST_LINE_S = 1.0
"""And a faster one no more often than this. [s]"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    it = argparse.ArgumentParser(
        prog="zengrid top", description="Watch a running market. Ctrl-C ends watching, nothing else."
    )
    add_bus_options(it)
    show = it.add_mutually_exclusive_group()
    show.add_argument("--once", action="store_true", help="show it once")
    show.add_argument("--json", action="store_true", help="print the clock's status once, as JSON")
    show.add_argument("--plain", action="store_true", help="lines instead of a table (so where there is no terminal)")
    it.add_argument("--events", type=Path, help=argparse.SUPPRESS)
    it.add_argument("--where", default="", help=argparse.SUPPRESS)
    return it


def main(arguments: Sequence[str]) -> int:
    """Show a market; returns the exit code."""
    options = parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _leave)
    from zengrid_cli.watch import Watch

    with Watch(options.run, options.connect, options.certs) as watch:
        if options.once or options.json:
            return _once(watch, as_json=options.json)
        try:
            if options.plain or not sys.stdout.isatty():
                _lines(watch)
            else:
                _live(watch, options)
        except KeyboardInterrupt:
            pass
    return 0


def _leave(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _once(watch: Watch, *, as_json: bool) -> int:
    if not watch.look(timeout_s=5.0):
        assert watch.error is not None
        raise watch.error
    assert watch.status is not None
    if as_json:
        from zengrid.wire.codec import encode

        print(encode(watch.status).decode())
        return 0
    from rich.console import Console

    from zengrid_cli.table import View, render

    console = Console(highlight=False)
    # Nothing has to fit a screen here.
    console.print(render(View(watch.status, watch.homes), 1000))
    return 0


def _each(interval_s: float, do: Callable[[], None]) -> None:
    """Do something again and again, without hurrying where it takes longer than the interval."""
    due = time.monotonic()
    while True:
        do()
        due = max(due + interval_s, time.monotonic())
        time.sleep(due - time.monotonic() if due > time.monotonic() else 0.0)


def _lines(watch: Watch) -> None:
    from zengrid_cli.lines import line

    shown: tuple[int, int] | None = None
    shown_at = -LINE_S
    told_away = False

    def show() -> None:
        nonlocal shown, shown_at, told_away
        if not watch.look():
            if not told_away and (watch.away_s or 0.0) > LINE_S:
                told_away = True
                print(f"the market is away: {watch.error}", flush=True)
            return
        told_away = False
        assert watch.status is not None
        last, now = watch.status.last, time.monotonic()
        if last is None or (last.day, last.position) == shown:
            return
        if shown is None or last.day != shown[0] or now >= shown_at + LINE_S:
            print(line(watch.status), flush=True)
            shown, shown_at = (last.day, last.position), now

    _each(SHORTEST_LINE_S, show)


def _await_start(watch: Watch, options: argparse.Namespace) -> None:
    """Wait for a market that runs: loading what a table needs would hold up one that starts."""
    told = options.events is not None
    while not watch.look() or watch.status is None or watch.status.state == "waiting":
        if not told and watch.status is None:
            told = True
            print(f"no market at {options.connect}, run {options.run}: waiting for one", file=sys.stderr, flush=True)
        time.sleep(START_LOOK_S)


def _live(watch: Watch, options: argparse.Namespace) -> None:
    _await_start(watch, options)
    from rich.console import Console
    from rich.live import Live

    from zengrid_cli.table import View, render
    from zengrid_cli.watch import last_lines

    console = Console(highlight=False)
    embedded = options.events is not None
    footer = "Ctrl-C ends the market" if embedded else "Ctrl-C ends watching"
    if options.where:
        footer = f"{options.where}   {footer}"

    def show() -> None:
        watch.look()
        assert watch.status is not None
        events = last_lines(options.events)
        view = View(watch.status, watch.homes, watch.away_s, events, footer)
        live.update(render(view, console.height), refresh=True)

    # What a market on this machine leaves on the screen is its summary.
    with Live(console=console, auto_refresh=False, transient=embedded, vertical_overflow="crop") as live:
        _each(FRAME_S, show)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
