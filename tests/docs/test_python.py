"""Python examples of the documentation run, and print what the page shows."""

from __future__ import annotations

import pytest

from support.doc_pages import ROOT, blocks

PAGES = ["docs/journal.md", "docs/model.md", "docs/policies.md", "docs/sweep.md"]
"""Those of pages with commands run between these, in ``test_commands.py``."""


@pytest.mark.parametrize("page", PAGES)
def test_python_examples_run_in_order(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    for block in blocks(page, "python"):
        # Blank lines in front make line numbers in errors those of the page.
        exec(compile("\n" * block.line + block.text, page, "exec"), names)
        printed = capsys.readouterr().out
        if block.shown is not None:
            assert printed == block.shown


@pytest.mark.parametrize("page", ["docs/http.md", "docs/own-agent.md", "docs/own-algorithm.md"])
def test_examples_with_a_name_are_the_files_of_that_name(page: str) -> None:
    named = {block.title: block.text for block in blocks(page, "python") if block.title}
    assert named == {name: (ROOT / "docs" / "examples" / name).read_text() for name in named}
    assert named
