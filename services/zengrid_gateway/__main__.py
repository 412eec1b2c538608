"""``python -m zengrid_gateway``: show one market over HTTP."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from zengrid import logs
from zengrid.bus.options import add_bus_options
from zengrid.errors import ZengridError


def parser() -> argparse.ArgumentParser:
    """The command line of the gateway."""
    it = argparse.ArgumentParser(prog="zengrid gateway", description="Show a market over HTTP: prices, history, page.")
    add_bus_options(it)
    it.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="where to listen (default: %(default)s)")
    it.add_argument("--port", type=int, default=8080, help="port, 0 for any free one (default: %(default)s)")
    it.add_argument(
        "--journal",
        metavar="FILE|URL",
        help="read history here, also of other runs, instead of asking the clock for its own",
    )
    it.add_argument(
        "--policies", type=Path, metavar="FOLDER", help="policy files, which answer where their agents are gone"
    )
    it.add_argument(
        "--protect",
        choices=["nothing", "writing", "everything"],
        help="what needs a token (default: nothing on loopback, elsewhere writing)",
    )
    it.add_argument(
        "--tokens",
        type=Path,
        metavar="FILE",
        help="hashes of the tokens, made when first needed (default: ~/.local/state/zengrid/tokens.json)",
    )
    it.add_argument(
        "--rate",
        type=float,
        metavar="N",
        help="requests a second of one client, 0 without limit (default: 0 on loopback, elsewhere 100)",
    )
    it.add_argument(
        "--cors",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="let pages of another site use this gateway, such as https://example.org; may be repeated",
    )
    logs.add_log_options(it)
    return it


def main(arguments: list[str] | None = None) -> int:
    """Serve until a signal asks to stop."""
    options = parser().parse_args(arguments)
    logs.begin("gateway", options, run=options.run)
    # Loaded after the command line is known to be right: FastAPI takes a second.
    from zengrid_gateway.access import open_access
    from zengrid_gateway.app import create_app
    from zengrid_gateway.server import serve
    from zengrid_gateway.settings import Settings, default_tokens

    settings = Settings(
        run=options.run,
        endpoint=options.connect,
        certs=options.certs,
        host=options.host,
        port=options.port,
        journal=options.journal,
        policies=options.policies,
        protect=options.protect,
        tokens=options.tokens or default_tokens(),
        rate=options.rate,
        origins=tuple(options.cors),
    )
    try:
        serve(create_app(settings, open_access(settings.protected, settings.tokens)), settings)
    except ZengridError as error:
        logs.fail(error)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
