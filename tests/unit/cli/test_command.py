"""The ``zengrid`` command: every word leads somewhere, and none loads more than it needs."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest

from zengrid import __version__
from zengrid.errors import ScenarioError
from zengrid_cli import __main__ as command


def zengrid(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "zengrid_cli", *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("word", command.COMMANDS)
def test_every_command_helps(word: str) -> None:
    assert find_spec(command.COMMANDS[word].target.partition(":")[0]) is not None
    helped = zengrid(word, "--help")
    assert helped.returncode == 0
    assert f"zengrid {word}" in helped.stdout or "zengrid prosumer" in helped.stdout or "zengrid grid" in helped.stdout
    assert not helped.stderr


def test_help_lists_all_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"  {word} " in said for word in command.COMMANDS)
    assert max(map(len, said.splitlines())) <= 80


def test_without_a_command_it_helps_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([]) == 2
    assert "usage: zengrid COMMAND" in capsys.readouterr().out


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--version"]) == 0
    assert capsys.readouterr().out == f"zengrid {__version__}\n"


def test_a_misspelt_command_gets_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["prosummer"]) == 2
    assert capsys.readouterr().err == "zengrid: command = prosummer: unknown; did you mean prosumer?\n"
    assert command.main(["xyzzy"]) == 2
    assert "permitted: up, top, control" in capsys.readouterr().err


def test_an_error_that_a_user_can_mend_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(word: str, arguments: list[str]) -> int:
        raise ScenarioError("days = 0: permitted: 1 and more")

    monkeypatch.setattr(command, "run", fail)
    assert command.main(["up"]) == 1
    assert capsys.readouterr().err == "zengrid up: days = 0: permitted: 1 and more\n"


def test_nothing_is_loaded_before_it_is_known_what_for() -> None:
    code = (
        "import sys; from zengrid_cli.__main__ import main; main(['--help']); "
        "print(*sorted({'numpy', 'pydantic', 'zenoh', 'typer', 'rich', 'yaml', 'argparse'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines()[-1] == ""
