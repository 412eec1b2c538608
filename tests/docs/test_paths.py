"""Files and modules that a page names in code font exist; the changelog may name old ones."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.doc_pages import ROOT
from zengrid.journal.statements import SCHEMA_VERSION

PAGES = sorted({*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")} - {ROOT / "CHANGELOG.md"})
FENCED = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
PATH = re.compile(r"(?:shared|services|tests|docs|benchmarks|deploy|tools|zengrid(?:_\w+)?)/[\w./-]+")
MODULE = re.compile(r"(?:python -m )?(zengrid(?:_\w+)?(?:\.\w+)+)(?: .*)?")
FILES = {"db", "json", "log", "yaml"}
"""Endings of files that begin with the project's name."""


def named(page: Path) -> Iterator[str]:
    """Every piece of inline code of a page."""
    yield from re.findall(r"`([^`\n]+)`", FENCED.sub("", page.read_text(encoding="utf-8")))


def is_file(path: str) -> bool:
    """Whether a path exists, seen from the project or from where its packages are."""
    return any((ROOT / folder / path).exists() for folder in ("", "shared", "services"))


def is_module(name: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError as error:
            if not name.startswith(error.name or ""):
                pytest.skip(f"{error.name} is not installed")
            continue
        for part in parts[length:]:
            found = getattr(found, part, None)
        return found is not None
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_and_modules_exist(page: Path) -> None:
    missing = []
    for code in named(page):
        if PATH.fullmatch(code):
            missing += [] if is_file(code) else [code]
        elif (module := MODULE.fullmatch(code)) and code.rpartition(".")[2] not in FILES:
            missing += [] if is_module(module[1]) else [code]
    assert missing == []


@pytest.mark.parametrize("code", ["tests/unit/nothing.py", "zengrid/core/nothing.py"])
def test_a_missing_file_is_found(code: str) -> None:
    assert PATH.fullmatch(code)
    assert not is_file(code)


@pytest.mark.parametrize("code", ["zengrid.core.nothing", "zengrid.core.settle.nothing"])
def test_a_missing_module_is_found(code: str) -> None:
    assert MODULE.fullmatch(code)
    assert not is_module(code)


def test_the_journal_has_the_version_that_the_page_says() -> None:
    text = " ".join((ROOT / "docs" / "operating.md").read_text(encoding="utf-8").split())
    assert f"currently {SCHEMA_VERSION} (" in text
    assert f"has schema version {SCHEMA_VERSION - 1}; this zengrid needs {SCHEMA_VERSION}:" in text
