"""The ``zengrid`` command: finds the module of a command, and loads nothing else."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from zengrid import __version__
from zengrid.errors import EXIT_USAGE
from zengrid_cli.command_table import COMMANDS, GROUPS

EXAMPLES = ("zengrid up", "zengrid help up")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that the first word names; return the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == ["help"] and len(words) > 1:
        words = [*words[1:], "--help"]
    if not words or words[0] in ("-h", "--help", "help"):
        print(usage())
        return 0 if words else EXIT_USAGE
    if words[0] in ("-V", "--version"):
        print(f"zengrid {__version__}")
        return 0
    if words[0] not in COMMANDS:
        print(f"zengrid: {unknown(words[0])}", file=sys.stderr)
        return EXIT_USAGE
    return run(words[0], words[1:])


def run(name: str, arguments: list[str]) -> int:
    """Load a command and run it."""
    # The matrices of a market are small: more threads in each of many processes only slow each other down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # pydantic's search for plugins takes longer than building all our messages.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    from zengrid.command_line.run_command import run_command

    command = COMMANDS[name]

    def load_and_run(arguments: Sequence[str]) -> int:
        if not {"-h", "--help"} & set(arguments):
            _load_pydantic()
        return command.load().main(command.arguments(arguments))

    return run_command(name, load_and_run, arguments)


def _load_pydantic() -> None:
    """Import pydantic so that Ctrl-C during the import ends the process; pydantic_core would report a broken Python."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    import pydantic_core  # noqa: F401

    signal.signal(signal.SIGINT, signal.default_int_handler)


def usage() -> str:
    """All commands with one line each."""
    width = max(map(len, COMMANDS))
    lines = ["usage: zengrid COMMAND ...", "", "A live market for a microgrid of prosumers."]
    for title, commands in GROUPS.items():
        lines += ["", f"{title}:", *(f"  {name:{width}}  {command.help}" for name, command in commands.items())]
    lines += ["", "options:", "  -h, --help     show this help", "  -V, --version  show the version"]
    lines += ["", "examples:", *(f"  {example}" for example in EXAMPLES)]
    lines += ["", "zengrid help COMMAND and zengrid COMMAND --help explain one command."]
    return "\n".join(lines)


def unknown(word: str) -> str:
    """The error about a word that is no command."""
    from zengrid.command_line.command_parser import suggestion

    return f"command = {word}: unknown{suggestion(word, COMMANDS)}"


if __name__ == "__main__":
    sys.exit(main())
