"""Shows a running market in a terminal: once, as lines, or as a live table."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable
from types import FrameType

from zengrid.wire.codec import encode
from zengrid_cli.live_view.status_line import format_status
from zengrid_cli.live_view.status_poller import StatusPoller, last_lines

FRAME_S = 0.2
START_POLL_S = 0.1
LINE_S = 5.0
"""A market that takes longer than this for a day gets a line at this interval. [s]"""
SHORTEST_LINE_S = 1.0
"""A faster market gets a line for each day, but not more often than this. [s]"""


def watch_market(options: argparse.Namespace) -> None:
    """Show a market as the command line of ``zengrid top`` asks."""
    signal.signal(signal.SIGTERM, _interrupt)
    with StatusPoller(options.run, options.connect, options.certs) as poller:
        if options.once or options.json:
            _show_once(poller, as_json=options.json)
            return
        try:
            if options.plain or not sys.stdout.isatty():
                _print_lines(poller)
            else:
                _show_live(poller, options)
        except KeyboardInterrupt:
            pass


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _show_once(poller: StatusPoller, *, as_json: bool) -> None:
    if not poller.poll(timeout_s=5.0):
        assert poller.error is not None
        raise poller.error
    assert poller.status is not None
    if as_json:
        print(encode(poller.status).decode())
        return
    from rich.console import Console

    from zengrid_cli.live_view.market_view import MarketView, render

    console = Console(highlight=False)
    # The output need not fit a screen.
    console.print(render(MarketView(poller.status, poller.homes), 1000))


def _repeat(interval_s: float, do: Callable[[], None]) -> None:
    """Do something at every interval; start the next interval late if it takes longer."""
    due = time.monotonic()
    while True:
        do()
        due = max(due + interval_s, time.monotonic())
        time.sleep(due - time.monotonic() if due > time.monotonic() else 0.0)


def _print_lines(poller: StatusPoller) -> None:
    shown: tuple[int, int] | None = None
    shown_at = -LINE_S
    reported_away = False

    def show() -> None:
        nonlocal shown, shown_at, reported_away
        if not poller.poll():
            if not reported_away and (poller.away_s or 0.0) > LINE_S:
                reported_away = True
                print(f"the market is away: {poller.error}", flush=True)
            return
        reported_away = False
        assert poller.status is not None
        last, now = poller.status.last, time.monotonic()
        if last is None or (last.day, last.position) == shown:
            return
        if shown is None or last.day != shown[0] or now >= shown_at + LINE_S:
            print(format_status(poller.status), flush=True)
            shown, shown_at = (last.day, last.position), now

    _repeat(SHORTEST_LINE_S, show)


def _await_start(poller: StatusPoller, options: argparse.Namespace) -> None:
    """Wait until the market runs: loading the table's libraries earlier would slow down its start."""
    reported = options.events is not None
    while not poller.poll() or poller.status is None or poller.status.state == "waiting":
        if not reported and poller.status is None:
            reported = True
            print(f"no market at {options.connect}, run {options.run}: waiting for one", file=sys.stderr, flush=True)
        time.sleep(START_POLL_S)


def _show_live(poller: StatusPoller, options: argparse.Namespace) -> None:
    _await_start(poller, options)
    from rich.console import Console
    from rich.live import Live

    from zengrid_cli.live_view.market_view import MarketView, render

    console = Console(highlight=False)
    embedded = options.events is not None
    footer = "Ctrl-C ends the market" if embedded else "Ctrl-C ends watching"
    if options.where:
        footer = f"{options.where}   {footer}"

    def show() -> None:
        poller.poll()
        assert poller.status is not None
        events = last_lines(options.events)
        view = MarketView(poller.status, poller.homes, poller.away_s, events, footer)
        live.update(render(view, console.height), refresh=True)

    # zengrid up prints its summary in place of the table.
    with Live(console=console, auto_refresh=False, transient=embedded, vertical_overflow="crop") as live:
        _repeat(FRAME_S, show)
