"""What a shell can complete: the subcommands, options and values of each command."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zengrid
from zengrid.command_line.command_parser import CommandParser
from zengrid_cli.command_table import COMMANDS, load_parser

HELP_OPTION = ("-h", "--help")


@dataclass(frozen=True, slots=True)
class CompletedArgument:
    """An option, or a positional argument if it has no names."""

    names: tuple[str, ...]
    help: str
    takes_value: bool
    values: tuple[str, ...] = ()
    """The values to offer"""
    files: bool = False
    """Whether to offer files"""


@dataclass(frozen=True, slots=True)
class CompletedCommand:
    """A command with its subcommands and arguments."""

    path: str
    """Words after ``zengrid``, such as ``journal verify``; empty for ``zengrid`` itself"""
    subcommands: dict[str, str] = field(default_factory=dict)
    """Help by name"""
    options: tuple[CompletedArgument, ...] = ()
    positional: tuple[CompletedArgument, ...] = ()


def completion_table() -> list[CompletedCommand]:
    """All commands and subcommands, from their parsers."""
    helped = {name: command.help for name, command in COMMANDS.items()}
    version = CompletedArgument(("-V", "--version"), "show the version", takes_value=False)
    options = (CompletedArgument(HELP_OPTION, "show this help", takes_value=False), version)
    found = [CompletedCommand("", {**helped, "help": "explain a command"}, options)]
    found.append(CompletedCommand("help", helped))
    for name in COMMANDS:
        found += _walk(name, load_parser(name))
    return found


def _walk(path: str, parser: CommandParser) -> Iterator[CompletedCommand]:
    arguments = [_argument(action) for action in parser.arguments()]
    subcommands = parser.subcommands()
    yield CompletedCommand(
        path,
        {name: _first_sentence(it.description or "") for name, it in subcommands.items()},
        tuple(argument for argument in arguments if argument.names),
        tuple(argument for argument in arguments if not argument.names),
    )
    for name, subparser in subcommands.items():
        yield from _walk(f"{path} {name}", subparser)


def _argument(action: argparse.Action) -> CompletedArgument:
    values = tuple(map(str, action.choices or ()))
    if action.dest == "scenario":
        values = built_in_scenarios()
    metavar = str(action.metavar or "")
    return CompletedArgument(
        names=tuple(action.option_strings),
        help=_first_sentence(_expand(action)),
        takes_value=action.nargs != 0,
        values=values,
        files=action.type is Path or "FILE" in metavar or action.dest in ("scenario", "policy", "grid_policy"),
    )


def built_in_scenarios() -> tuple[str, ...]:
    """Names of the scenarios that come with zengrid; their package is not loaded, since it takes a while."""
    folder = Path(zengrid.__file__).parent / "scenario" / "builtin"
    return tuple(sorted(path.stem for path in folder.glob("*.yaml")))


def _expand(action: argparse.Action) -> str:
    """The help of an argument without its default."""
    return (action.help or "").partition(" (default")[0].replace("%%", "%")


def _first_sentence(text: str) -> str:
    return text.partition(". ")[0].partition(": ")[0].rstrip(".")
