"""Commands in the documentation that train for minutes are what they should be: everything but the training is done."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

from support.doc_pages import blocks
from zengrid.errors import ZengridError
from zengrid_cli.commands import reproduce_command, sweep_command
from zengrid_cli.training.run_reproduction import plan_study
from zengrid_cli.training.run_sweep import parse_axis, plan_sweep


def shown() -> Iterator[tuple[list[str], str]]:
    """Words of each command, and what the page says it prints."""
    for page in ("docs/reproduce.md", "docs/sweep.md"):
        for block in blocks(page, "console"):
            for part in block.text.split("$ ")[1:]:
                command, _, printed = part.partition("\n")
                yield shlex.split(command, comments=True), printed


@pytest.mark.parametrize(("words", "printed"), [pytest.param(*one, id=" ".join(one[0])) for one in shown()])
def test_a_command_plans_what_the_page_says(words: list[str], printed: str, tmp_path: Path) -> None:
    assert words[0] == "zengrid"
    said = planned(words, tmp_path)
    assert bool(said) == bool(printed), said
    assert said.startswith(printed.rstrip().removesuffix("..."))


def planned(words: list[str], folder: Path) -> str:
    """Plan what a command would train; the error, if it is refused."""
    try:
        if words[1] == "reproduce":
            left = plan_study(reproduce_command.parser().parse_args(words[2:]), "").jobs()
        else:
            options = sweep_command.parser().parse_args(words[2:])
            axes = dict(parse_axis(text) for text in options.vary)
            left = plan_sweep(options, axes, folder, "").jobs()
    except ZengridError as error:
        return f"zengrid {words[1]}: {error}"
    assert left
    return ""
