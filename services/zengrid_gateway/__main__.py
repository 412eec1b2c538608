"""``python -m zengrid_gateway``: show one market over HTTP."""

from __future__ import annotations

import argparse
import sys

from zengrid.bus.options import add_bus_options
from zengrid.errors import ZengridError
from zengrid_gateway.settings import Settings


def parser() -> argparse.ArgumentParser:
    """The command line of the gateway."""
    it = argparse.ArgumentParser(prog="zengrid gateway", description="Show a market over HTTP: prices, history, page.")
    add_bus_options(it)
    it.add_argument(
        "--journal", metavar="FILE|URL", help="read history here, also of other runs, instead of asking the clock"
    )
    it.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="where to listen (default: %(default)s)")
    it.add_argument("--port", type=int, default=8080, help="port, 0 for any free one (default: %(default)s)")
    return it


def main(arguments: list[str] | None = None) -> int:
    """Serve until a signal asks to stop."""
    options = parser().parse_args(arguments)
    # Loaded after the command line is known to be right: FastAPI takes a second.
    from zengrid_gateway.app import create_app
    from zengrid_gateway.server import serve

    settings = Settings(
        run=options.run, endpoint=options.connect, host=options.host, port=options.port, journal=options.journal
    )
    try:
        serve(create_app(settings), settings)
    except ZengridError as error:
        print(f"zengrid gateway: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
