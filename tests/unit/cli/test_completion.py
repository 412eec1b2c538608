"""The completion scripts complete commands, options and values, without starting ``zengrid``."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from support.commands import run_zengrid
from zengrid_cli.completion.completion_table import built_in_scenarios, completion_table


def complete(script: Path, *words: str, folder: Path) -> list[str]:
    """What bash offers for the last word, with nothing but bash on the path."""
    array = " ".join(map(shlex.quote, words))
    code = f"""
        source {shlex.quote(str(script))}
        COMP_WORDS=({array}) COMP_CWORD={len(words) - 1}
        $(complete -p zengrid | sed -E 's/.*-F (\\S+).*/\\1/')
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    ended = subprocess.run(
        ["bash", "--norc", "-c", code], cwd=folder, env={"PATH": "/usr/bin:/bin"}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert not ended.stderr
    return ended.stdout.split()


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    result = run_zengrid("completion", "bash")
    assert result.exit_code == 0
    path = tmp_path_factory.mktemp("completion") / "zengrid.bash"
    path.write_text(result.stdout)
    return path


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("zengrid jo", ["journal"]),
        ("zengrid help swe", ["sweep"]),
        ("zengrid journal ''", ["verify", "backup", "prune"]),
        ("zengrid control sp", ["speed"]),
        ("zengrid control speed --co", ["--connect"]),
        ("zengrid up --soc", ["--soc-reset"]),
        ("zengrid up --soc-reset ''", ["daily", "never"]),
        ("zengrid up --soc-reset = d", ["daily"]),
        ("zengrid up --soc-reset =", ["daily", "never"]),
        ("zengrid up --days ''", []),
        ("zengrid up --days 3 vil", ["village"]),
        ("zengrid completion ''", ["bash", "zsh", "fish"]),
        ("zengrid evaluate pol", ["policy.safetensors"]),
        ("zengrid train --data meas", ["measured"]),
        ("zengrid prosumer --encoding b", ["binary"]),
        ("zengrid up --no-such-option ''", [*built_in_scenarios(), "measured", "policy.safetensors"]),
    ],
)
def test_bash_offers(script: Path, tmp_path: Path, words: str, offered: list[str]) -> None:
    (tmp_path / "policy.safetensors").touch()
    (tmp_path / "measured").mkdir()
    assert sorted(complete(script, *shlex.split(words), folder=tmp_path)) == sorted(offered)


def test_bash_offers_every_command_and_option(script: Path, tmp_path: Path) -> None:
    for command in completion_table():
        words = ["zengrid", *command.path.split()]
        assert set(command.subcommands) <= set(complete(script, *words, "", folder=tmp_path))
        names = {name for option in command.options for name in option.names}
        assert set(complete(script, *words, "-", folder=tmp_path)) == names


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_every_command_and_option(shell: str) -> None:
    text = run_zengrid("completion", shell).stdout
    for command in completion_table():
        for name in command.subcommands:
            assert name in text
        for option in command.options:
            for name in option.names:
                assert (name if shell == "zsh" else f" {'-l' if name[:2] == '--' else '-s'} {name.strip('-')}") in text
    if shutil.which(shell):
        checked = subprocess.run([shell, "-n"], input=text, capture_output=True, text=True, check=False)
        assert (checked.returncode, checked.stderr) == (0, "")
