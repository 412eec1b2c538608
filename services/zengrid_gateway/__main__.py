"""``python -m zengrid_gateway``: shows one market over HTTP."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from zengrid import logs
from zengrid.command_line.bus_options import add_bus_options
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.log_options import add_log_options
from zengrid.command_line.run_command import run_command
from zengrid.command_line.value_parsers import Number, WholeNumber


def parser() -> CommandParser:
    """Make the parser of the command line."""
    it = CommandParser(
        prog="zengrid gateway",
        description="Show a market over HTTP: prices, history, and a web page.",
        examples=["zengrid gateway --port 8080", "zengrid gateway --host 0.0.0.0 --journal zengrid.db"],
    )
    add_bus_options(it.add_argument_group("network"))
    http = it.add_argument_group("HTTP")
    http.add_argument("--host", default="127.0.0.1", metavar="ADDRESS", help="address to listen on")
    http.add_argument("--port", type=WholeNumber(0, 65535), default=8080, metavar="PORT", help="port; 0: any free port")
    http.add_argument(
        "--protect",
        choices=["nothing", "writing", "everything"],
        help="which requests need a token (default: nothing on loopback, else writing)",
    )
    http.add_argument(
        "--tokens",
        type=Path,
        metavar="FILE",
        help="hashes of the tokens, made when first needed (default: ~/.local/state/zengrid/tokens.json)",
    )
    http.add_argument(
        "--rate",
        type=Number(),
        metavar="N",
        help="largest number of requests per second of one client; 0: no limit (default: 0 on loopback, else 100)",
    )
    http.add_argument(
        "--cors",
        action="append",
        default=[],
        metavar="ORIGIN",
        help="allow pages of another site to use this gateway, such as https://example.org; may be repeated",
    )
    data = it.add_argument_group("data")
    data.add_argument(
        "--journal",
        metavar="FILE|URL",
        help="read past slots here, also of other runs (default: ask the clock, which knows its own run alone)",
    )
    data.add_argument(
        "--policies", type=Path, metavar="FOLDER", help="policy files, which act for agents that have gone"
    )
    add_log_options(it)
    return it


def main(arguments: Sequence[str]) -> int:
    """Serve until a signal asks to stop."""
    options = parser().parse_args(arguments)
    logs.configure("gateway", options, run=options.run)
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
    serve(create_app(settings, open_access(settings.protected, settings.tokens)), settings)
    return 0


if __name__ == "__main__":
    sys.exit(run_command("gateway", main, sys.argv[1:]))
