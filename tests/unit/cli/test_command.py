"""The ``zengrid`` command: every command has help, one style of errors, and loads no more than it needs."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence

import pytest

from support.commands import run_zengrid
from zengrid import __version__
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.run_command import run_command
from zengrid.errors import ScenarioError
from zengrid_cli.command_table import COMMANDS, load_parser

HEAVY_MODULES = ("numpy", "pydantic", "zenoh", "rich", "yaml", "torch", "cryptography")


def parsers() -> Iterator[tuple[str, CommandParser]]:
    """The parser of every command and subcommand, by its words."""

    def walk(path: str, parser: CommandParser) -> Iterator[tuple[str, CommandParser]]:
        yield path, parser
        for name, subparser in parser.subcommands().items():
            yield from walk(f"{path} {name}", subparser)

    for name in COMMANDS:
        yield from walk(name, load_parser(name))


PARSERS = dict(parsers())


@pytest.mark.parametrize("path", PARSERS)
def test_every_command_has_help_with_examples_that_parse(path: str) -> None:
    by_option, by_word = run_zengrid(*path.split(), "--help"), run_zengrid("help", *path.split())
    assert by_option == by_word
    assert by_option.exit_code == 0
    assert by_option.stdout.startswith(f"usage: zengrid {path}")
    assert not by_option.stderr
    parser = PARSERS[path]
    assert parser.examples
    for example in parser.examples:
        words = shlex.split(example.split(">")[0].removeprefix("source <(").removesuffix(")"))
        assert words[0] == "zengrid"
        load_parser(words[1]).parse_args(words[2:])


@pytest.mark.parametrize("path", PARSERS)
def test_every_argument_is_explained(path: str) -> None:
    for action in PARSERS[path].arguments():
        assert action.help, action.dest
        if action.nargs != 0 and action.option_strings and action.choices is None:
            assert action.metavar, f"{action.option_strings} takes a value without a name"


def test_help_lists_all_commands() -> None:
    for words in (["--help"], ["-h"], ["help"]):
        result = run_zengrid(*words)
        assert result.exit_code == 0
        assert all(f"  {word} " in result.stdout for word in COMMANDS)
        assert max(map(len, result.stdout.splitlines())) <= 80


def test_without_a_command_it_helps_and_fails() -> None:
    result = run_zengrid()
    assert result.exit_code == 2
    assert "usage: zengrid COMMAND" in result.stdout


def test_the_version() -> None:
    assert run_zengrid("--version") == (0, f"zengrid {__version__}\n", "")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("prosummer", "zengrid: command = prosummer: unknown; did you mean prosumer?"),
        ("help jurnal", "zengrid: command = jurnal: unknown; did you mean journal?"),
        ("control puase", "zengrid control: command = puase: unknown; did you mean pause?; see zengrid control --help"),
        ("up --dayz=3", "zengrid up: option = --dayz: unknown; did you mean --days?; see zengrid up --help"),
        ("up --log xml", "zengrid up: --log = xml: unknown; permitted: text, json; see zengrid up --help"),
        ("up --day 3", "zengrid up: option = --day: unknown; did you mean --days?; see zengrid up --help"),
        ("up paper two", "zengrid up: value = two: one argument too many; see zengrid up --help"),
        (
            "gateway --port 99999",
            "zengrid gateway: --port = 99999: permitted: a whole number 0 to 65535; see zengrid gateway --help",
        ),
        (
            "clock --deadline 0",
            "zengrid clock: --deadline = 0: permitted: a number above 0 up to 3600 s; see zengrid clock --help",
        ),
        (
            "journal prune --keep-days 0",
            (
                "zengrid journal prune: --keep-days = 0: permitted: a whole number from 1 up; "
                "see zengrid journal prune --help"
            ),
        ),
        (
            "prosumer --id p1 --pv nan",
            "zengrid prosumer: --pv = nan: permitted: a number from 0 kW up; see zengrid prosumer --help",
        ),
        (
            "prosumer",
            "zengrid prosumer: the following arguments are required: --id; see zengrid prosumer --help",
        ),
        (
            "health --connect tcp/clock",
            "zengrid health: --connect = tcp/clock: permitted: PROTOCOL/HOST:PORT; see zengrid health --help",
        ),
    ],
)
def test_a_wrong_command_line_is_one_sentence_and_exit_code_2(words: str, error: str) -> None:
    assert run_zengrid(*words.split()) == (2, "", f"{error}\n")


def test_an_unknown_command_far_from_all_lists_them() -> None:
    assert "permitted: up, top, control" in run_zengrid("xyzzy").stderr


def test_a_value_from_the_environment_is_checked_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENGRID_LOG", "xml")
    result = run_zengrid("up", "--days", "1")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--log = xml: unknown; permitted: text, json" in result.stderr


def test_the_help_names_the_environment_variable_and_the_default() -> None:
    text = " ".join(run_zengrid("top", "--help").stdout.split())
    assert "(default: tcp/127.0.0.1:7447; environment: ZENGRID_CONNECT)" in text
    assert "(environment: ZENGRID_CERTS)" in text


@pytest.mark.parametrize(
    ("error", "code", "stderr"),
    [
        (ScenarioError("days = 0: permitted: 1 and more"), 1, "zengrid up: days = 0: permitted: 1 and more\n"),
        (KeyboardInterrupt(), 130, ""),
        (BrokenPipeError(), 0, ""),
    ],
)
def test_errors_become_exit_codes(
    error: BaseException, code: int, stderr: str, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(arguments: Sequence[str]) -> int:
        raise error

    assert run_command("up", fail, []) == code
    assert capfd.readouterr().err == stderr


def test_an_internal_error_has_its_own_exit_code_and_a_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    def fail(arguments: Sequence[str]) -> int:
        return 1 // len(arguments)

    assert run_command("up", fail, []) == 70
    error = capsys.readouterr().err
    assert error.startswith("zengrid up: Traceback")
    assert error.rstrip().endswith("ZeroDivisionError: integer division or modulo by zero")


def loaded_modules(words: Sequence[str], modules: Sequence[str]) -> list[str]:
    """Which of these modules a command loads in a process of its own."""
    code = (
        f"import sys; from zengrid_cli.__main__ import main; main({list(words)!r}); "
        f"print('loaded:', *sorted(set({list(modules)!r}) & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return ended.stdout.splitlines()[-1].split()[1:]


def test_help_and_version_load_nothing() -> None:
    for words in (["--help"], ["--version"]):
        assert loaded_modules(words, [*HEAVY_MODULES, "argparse"]) == []


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_the_help_of_a_command_loads_no_library(name: str) -> None:
    assert loaded_modules([name, "--help"], HEAVY_MODULES) == []


def test_metavars_are_capitals() -> None:
    for path, parser in PARSERS.items():
        for action in parser.arguments():
            if action.metavar is not None:
                assert re.fullmatch(r"[A-Z0-9|:=,.]+", str(action.metavar)), f"{path}: {action.metavar}"
