"""The documentation names every command, option and environment variable, and no other."""

from __future__ import annotations

import argparse
import re
import runpy
import shlex
from collections.abc import Iterator

import pytest

from support.doc_pages import ROOT, blocks
from zengrid.command_line.command_parser import CommandParser
from zengrid_cli.command_table import COMMANDS, load_parser

PAGES = ["README.md", *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "docs").glob("*.md")))]
SOURCES = ("shared", "services", "deploy", "docker-compose.yml", "Dockerfile")
VARIABLE = re.compile(r"\bZENGRID_[A-Z][A-Z_]*[A-Z]\b")


def text_of(folder: str) -> str:
    """All text files below a folder."""
    root = ROOT / folder
    paths = [root] if root.is_file() else [path for path in root.rglob("*") if path.is_file()]
    texts = (path for path in paths if path.suffix in ("", ".py", ".yaml", ".yml", ".env", ".sh"))
    return "\n".join(path.read_text(encoding="utf-8") for path in texts)


def documentation() -> str:
    """All pages."""
    return "\n".join((ROOT / page).read_text(encoding="utf-8") for page in PAGES)


def options(parser: CommandParser) -> Iterator[argparse.Action]:
    """All options of a command and its subcommands."""
    yield from (action for action in parser.arguments() if action.option_strings)
    for subparser in parser.subcommands().values():
        yield from options(subparser)


def test_the_reference_of_the_commands_is_up_to_date() -> None:
    reference = runpy.run_path(str(ROOT / "tools" / "write_command_reference.py"))["reference"]
    assert (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8") == reference(), "run: make reference"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_documented(command: str) -> None:
    text = documentation()
    assert f"zengrid {command}" in text
    for action in options(load_parser(command)):
        long = [option for option in action.option_strings if option.startswith("--")]
        assert long, f"zengrid {command} {action.option_strings}: has no long form"
        for option in long:
            assert re.search(rf"{option}\b", text), f"zengrid {command} {option}: not in docs/*.md"


@pytest.mark.parametrize("page", PAGES)
def test_every_option_that_a_page_uses_exists(page: str) -> None:
    for block in blocks(page, "console", "bash", "text"):
        for line in block.text.splitlines():
            found = re.match(r"(?:\$ )?(?:[A-Z_]+=\S+ )*zengrid ([a-z]+)\b(.*)", line)
            if found is None or found[1] not in COMMANDS:
                continue
            known = {name for action in options(load_parser(found[1])) for name in action.option_strings}
            for word in shlex.split(found[2], comments=True):
                name = word.partition("=")[0]
                if name.startswith("--"):
                    assert name in {*known, "--help"}, f"{page}: {line}"


def test_every_environment_variable_is_documented() -> None:
    used = set(VARIABLE.findall("\n".join(text_of(folder) for folder in SOURCES)))
    assert len(used) > 10
    assert used - set(VARIABLE.findall(documentation())) == set()
