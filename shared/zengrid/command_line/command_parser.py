"""The parser of every command: one style of help, one style of errors, and suggestions for misspelt words."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from zengrid.errors import EXIT_USAGE

HELP_COLUMN = 30
"""Column at which the text of each option starts."""
SUGGEST_FROM = 0.6
"""How similar a word must be to be suggested, from 0 (nothing in common) to 1 (equal)."""


class CommandParser(argparse.ArgumentParser):
    """Parses the arguments of one command.

    Values from environment variables and defaults are checked in the same way as values on the command line. An error
    ends the process with exit code 2 and one sentence on stderr.

    Parameters
    ----------
    examples:
        Command lines that the help shows.
    settings:
        Arguments of ``argparse.ArgumentParser``.
    """

    def __init__(self, *, examples: Sequence[str] = (), **settings: Any) -> None:
        settings.setdefault("formatter_class", _HelpFormatter)
        super().__init__(allow_abbrev=False, **settings)
        self.examples = tuple(examples)

    def format_help(self) -> str:
        """The help text, with the examples at its end."""
        text = super().format_help()
        if self.examples:
            text += "\nexamples:\n" + "".join(f"  {example}\n" for example in self.examples)
        return text

    def subcommands(self) -> dict[str, CommandParser]:
        """The parsers of the subcommands by their names."""
        found: dict[str, CommandParser] = {}
        for action in self._actions:
            if isinstance(action, argparse._SubParsersAction):
                found.update(action.choices)
        return found

    def arguments(self) -> list[argparse.Action]:
        """All options and positional arguments that the help shows, but not the subcommands."""
        return [
            action
            for action in self._actions
            if not isinstance(action, argparse._SubParsersAction) and action.help != argparse.SUPPRESS
        ]

    def error(self, message: str) -> NoReturn:
        """End the process with one sentence on stderr."""
        message = message.removeprefix("argument ")
        self.exit(EXIT_USAGE, f"{self.prog}: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse like ``argparse``, but refuse unknown arguments here, where the known options are at hand."""
        parsed, unknown = super().parse_known_args(args, namespace)
        if unknown:
            word = unknown[0].partition("=")[0]
            if word.startswith("-"):
                options = [option for action in self.arguments() for option in action.option_strings]
                self.error(f"option = {word}: unknown{suggestion(word, options)}")
            self.error(f"value = {word}: one argument too many")
        return parsed, unknown

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Convert one value; say what is permitted where it cannot be converted."""
        try:
            value = super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            self.error(f"{_name(action)} = {arg_string}: {error.message}")
        if not isinstance(action, argparse._SubParsersAction):
            # argparse does not check defaults against the choices, and a default may come from the environment.
            self._check_value(action, value)
        return value

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            self.error(f"{_name(action)} = {value}: unknown{suggestion(str(value), action.choices)}")


class EnvironmentOption(argparse.Action):
    """An option whose value comes from an environment variable if the option is not given."""

    def __init__(self, *, environment: str, default: Any = None, **settings: Any) -> None:
        super().__init__(default=os.environ.get(environment) or default, **settings)
        self.environment = environment

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        """Store the value."""
        setattr(namespace, self.dest, values)


def suggestion(word: str, known: Iterable[str]) -> str:
    """What to add to an error about an unknown word: the most similar known word, or else all of them."""
    names = [name for name in known if name not in ("-h", "--help")]
    similar = get_close_matches(word, names, n=1, cutoff=SUGGEST_FROM)
    return f"; did you mean {similar[0]}?" if similar else f"; permitted: {', '.join(names)}"


def _name(action: argparse.Action) -> str:
    """The name of an argument in an error."""
    if action.option_strings:
        return action.option_strings[-1]
    return action.dest if action.metavar is None else str(action.metavar).lower()


class _HelpFormatter(argparse.HelpFormatter):
    """Adds the default value and the environment variable to the text of each option."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=HELP_COLUMN)

    def _get_help_string(self, action: argparse.Action) -> str:
        return _help_template(action)


def help_text(action: argparse.Action) -> str:
    """What the help says about an argument, with its limits, default and environment variable."""
    return _help_template(action) % vars(action)


def _help_template(action: argparse.Action) -> str:
    """The help of an argument before the insertion of its default."""
    text, default = action.help or "", action.default
    limits = getattr(action.type, "limits", "")
    remarks = [limits] if limits else []
    has_default = default is not None and default is not False and default not in ([], argparse.SUPPRESS)
    if has_default and "default" not in text:
        remarks.append("default: %(default)g" if isinstance(default, float) else "default: %(default)s")
    if isinstance(action, EnvironmentOption):
        remarks.append(f"environment: {action.environment}")
    if not remarks:
        return text
    if text.endswith(")"):
        return f"{text[:-1]}; {'; '.join(remarks)})"
    return f"{text} ({'; '.join(remarks)})"
