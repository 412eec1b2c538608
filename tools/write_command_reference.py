"""Writes the reference of all commands, ``docs/command-line.md``, from their parsers: ``make reference``."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

from zengrid.command_line.command_parser import CommandParser, EnvironmentOption, help_text
from zengrid_cli.command_table import GROUPS, load_parser

PAGE = Path(__file__).parents[1] / "docs" / "command-line.md"
WIDTH = 100
INTRODUCTION = """\
# Command line

This page lists every command of `zengrid` with all its options. `zengrid help COMMAND` and
`zengrid COMMAND --help` show the same in a terminal.
It is generated from the commands themselves by `make reference`.

## In general

**Exit codes.** 0: done. 1: failed, for a reason that one sentence on stderr names. 2: the command line is wrong.
70: internal error of zengrid, with a traceback on stderr. 130: interrupted with Ctrl-C.

**Completion.** `source <(zengrid completion bash)` in `~/.bashrc` completes commands, options and their values;
`zengrid completion zsh` and `zengrid completion fish` print scripts for those shells.

**Environment.** Some options take their value from an environment variable if they are not given:
"""


def reference() -> str:
    """The text of the page."""
    parsers = {name: load_parser(name) for group in GROUPS.values() for name in group}
    variables: dict[str, str] = {}
    for parser in parsers.values():
        for action in _all_arguments(parser):
            if isinstance(action, EnvironmentOption):
                variables.setdefault(action.environment, action.option_strings[-1])
    parts = ["\n\n".join(_wrap(paragraph) for paragraph in INTRODUCTION.strip().split("\n\n")), "\n\n"]
    parts += [f"- `{variable}`: `{option}`\n" for variable, option in sorted(variables.items())]
    for title, commands in GROUPS.items():
        parts.append(f"\n## {title}\n")
        parts += [_command(f"zengrid {name}", parsers[name], "###") for name in commands]
    return "".join(parts)


def _all_arguments(parser: CommandParser) -> list[argparse.Action]:
    found = parser.arguments()
    for subparser in parser.subcommands().values():
        found += _all_arguments(subparser)
    return found


def _command(words: str, parser: CommandParser, heading: str) -> str:
    """The section of a command and those of its subcommands."""
    parts = [f"\n{heading} {words}\n\n{_wrap(parser.description or '')}\n\n"]
    parts += ["```text\n", *(f"{example}\n" for example in parser.examples), "```\n"]
    items = [_item(action) for action in parser.arguments() if action.dest != "help"]
    if items:
        parts += ["\n", *items]
    parts += [_command(f"{words} {name}", subparser, f"{heading}#") for name, subparser in parser.subcommands().items()]
    return "".join(parts)


def _item(action: argparse.Action) -> str:
    """A list item about an argument."""
    names = ", ".join(action.option_strings) or str(action.metavar or action.dest).upper()
    value = ""
    if action.option_strings and action.nargs != 0 and not isinstance(action, argparse.BooleanOptionalAction):
        value = " " + str(action.metavar or "|".join(map(str, action.choices or ())))
    required = "Required: " if action.required and action.option_strings else ""
    return _wrap(f"- `{names}{value}`: {required}{help_text(action)}", indent="  ") + "\n"


def _wrap(text: str, indent: str = "") -> str:
    return textwrap.fill(
        " ".join(text.split()), WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
