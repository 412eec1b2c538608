"""The ``zengrid`` command: finds the module that does what is asked for, and loads nothing else."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

from zengrid import __version__
from zengrid.errors import ZengridError


class Command(NamedTuple):
    """What one word stands for.

    ``module`` alone is a service, run as ``python -m`` does. ``module:name`` is a function that takes its arguments and
    returns an exit code, or where ``typer`` is set, a typer application or one function of it.
    """

    target: str
    help: str
    typer: bool = False


COMMANDS = {
    "up": Command("zengrid_cli.up:main", "run a whole market on this machine"),
    "top": Command("zengrid_cli.top:main", "watch a running market from anywhere"),
    "control": Command("zengrid_cli.control:main", "pause, resume, step, speed up or stop a market"),
    "export": Command("zengrid_cli.export:export", "write a journal as CSV or Parquet", typer=True),
    "journal": Command("zengrid_cli.journal:app", "verify, back up and prune a journal", typer=True),
    "train": Command("zengrid_cli.train:main", "train agents in a simulated market"),
    "evaluate": Command("zengrid_cli.evaluate:main", "how good policies are, and how far from the best possible"),
    "reproduce": Command("zengrid_cli.reproduce:main", "every figure and number of the paper, from nothing"),
    "sweep": Command("zengrid_cli.sweep:main", "train over values and seeds, on all processors or a cluster"),
    "health": Command("zengrid_cli.health:main", "whether the process here is connected to its market"),
    "scenario": Command("zengrid_cli.scenario:app", "show, check and export scenarios", typer=True),
    "prosumer": Command("zengrid_agent", "one prosumer agent, also in a market that runs already"),
    "grid": Command("zengrid_agent", "the grid agent"),
    "clock": Command("zengrid_clock", "the market's clock alone: environment, settlement, journal"),
    "gateway": Command("zengrid_gateway", "a market over HTTP: prices, history, page"),
    "certs": Command("zengrid_cli.certs:main", "certificates, for markets that strangers can reach"),
    "spawner": Command("zengrid_spawner", "starts prosumers on this machine for whoever asks, such as the page"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Do what the first word says; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if words else 2
    if words[0] in ("-V", "--version"):
        print(f"zengrid {__version__}")
        return 0
    if words[0] not in COMMANDS:
        print(f"zengrid: {unknown(words[0])}", file=sys.stderr)
        return 2
    # Markets multiply small matrices: more threads in each of many processes only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Looking for plugins of pydantic takes longer than building all our messages.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    try:
        return run(words[0], words[1:])
    except ZengridError as error:
        from zengrid import logs

        print(f"zengrid {words[0]}: {logs.printable(str(error))}", file=sys.stderr)
        return 1
    except BrokenPipeError:
        # Whoever read the output has seen enough; Python would complain when it flushes at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0
    except KeyboardInterrupt:
        return 130


def run(word: str, arguments: list[str]) -> int:
    """Load a command and run it."""
    _load_pydantic()
    command = COMMANDS[word]
    module, _, name = command.target.partition(":")
    if not name:
        return _serve(word, module, arguments)
    from importlib import import_module

    found: Any = getattr(import_module(module), name)
    if not command.typer:
        return cast("int", found(arguments))
    import typer

    app = found
    if not isinstance(app, typer.Typer):
        app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
        app.command()(found)
    app(args=arguments, prog_name=f"zengrid {word}", standalone_mode=True)
    return 0


def _load_pydantic() -> None:
    """Ctrl-C at this moment ends the process; the library would take it for a broken Python, and say so at length."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    import pydantic_core  # noqa: F401

    signal.signal(signal.SIGINT, signal.default_int_handler)


def _serve(word: str, module: str, arguments: list[str]) -> int:
    """Services run in this process, as if they had been started by themselves."""
    import runpy

    # The agent service is told which of its agents to be.
    role = [word] if module == "zengrid_agent" else []
    sys.argv = [f"zengrid {word}", *role, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=False)
    return 0


def usage() -> str:
    """All commands with one line each."""
    width = max(map(len, COMMANDS))
    lines = [f"  {word:{width}}  {command.help}" for word, command in COMMANDS.items()]
    return "\n".join(
        [
            "usage: zengrid COMMAND ...",
            "",
            "A live market for a microgrid of prosumers. Try: zengrid up",
            "",
            *lines,
            "",
            "zengrid COMMAND --help tells more; zengrid --version tells the version.",
        ]
    )


def unknown(word: str) -> str:
    """What to say about a word that is no command."""
    from difflib import get_close_matches

    close = get_close_matches(word, COMMANDS, n=1)
    if close:
        return f"command = {word}: unknown; did you mean {close[0]}?"
    return f"command = {word}: unknown; permitted: {', '.join(COMMANDS)}"


if __name__ == "__main__":
    sys.exit(main())
