"""The prose check finds each kind of fault, on the right line, and leaves code and tables alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import prose
from support.doc_pages import ROOT

STYLE = prose.Style.load()


def faults(tmp_path: Path, text: str) -> list[str]:
    """Line and message of each fault of a page."""
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    return [f"{fault.line}: {fault.message}" for fault in prose.check_page(page, STYLE)]


def test_plain_text_has_no_fault(tmp_path: Path) -> None:
    text = "# A page\n\nThe clock settles each slot. See [the model](model.md#one-slot), *eq. 13* and `told`.\n"
    assert faults(tmp_path, text) == []


def test_a_wide_line_is_found_and_its_line_is_named(tmp_path: Path) -> None:
    line = "The clock settles the slot and writes it into the journal. " * 2
    assert faults(tmp_path, f"# A page\n\n{line}\n") == ["3: line of 118 columns; at most 100"]


@pytest.mark.parametrize(
    "text",
    [
        f"| a | {'word ' * 30}|\n|---|---|\n",
        f"```sh\n{'word ' * 40}\n```\n",
        f"~~~\n```\n{'told ' * 40}\n~~~\n",
        f"# {'word ' * 25}\n",
        f"See <http://example.org/{'x' * 100}> first.\n",
        f"<!-- {'told ' * 40} -->\n",
    ],
    ids=["table", "code", "code with another fence in it", "heading", "URL", "comment"],
)
def test_what_cannot_be_wrapped_may_be_wide(text: str, tmp_path: Path) -> None:
    assert faults(tmp_path, text) == []


def test_a_long_sentence_is_found_across_lines(tmp_path: Path) -> None:
    text = "Short one.\n\n" + "one two three four five six seven eight nine ten\n" * 4
    (fault,) = faults(tmp_path, text)
    assert fault.startswith("3: sentence of 40 words; at most 35: one two")


def test_sentences_end_at_full_stops_only(tmp_path: Path) -> None:
    half = "one two three four five six seven eight nine ten one two three four five six"
    assert faults(tmp_path, f"{half}.\n{half.capitalize()}.\n") == []
    (fault,) = faults(tmp_path, f"{half}, e.g. as in eq. 13\n{half.capitalize()}.\n")
    assert fault.startswith("1: sentence of 37 words")


def test_list_items_are_sentences_of_their_own(tmp_path: Path) -> None:
    item = "- one two three four five six seven eight nine ten one two three four five six seven eight\n"
    assert faults(tmp_path, item * 3) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("An agent hears of\nthe price.", '1: "hears of": write receives, learns, or sees'),
        ("The twin runs.", '1: "twin": write baseline, second session, or over the memory limit'),
        ("It uses zenoh.", '1: "zenoh": spelled Zenoh'),
        ("It uses Postgresql.", '1: "Postgresql": spelled PostgreSQL'),
        ("Its behavior is odd.", '1: "behavior": write behaviour'),
        ("Who dies is served by a rule.", '1: a statement begins with "Who": put the subject first'),
        ("| told that it ends |\n|---|", '1: "told that": write receives, knows, or unless you set it'),
    ],
)
def test_phrases_and_terms_are_found(text: str, said: str, tmp_path: Path) -> None:
    assert said in faults(tmp_path, text)


@pytest.mark.parametrize("text", ["Who sells?", "`zenoh` and [HTTP](http.md)", "A whole twinkle.", "told"])
def test_what_only_looks_like_a_fault_is_none(text: str, tmp_path: Path) -> None:
    assert faults(tmp_path, text) == []


def test_a_page_may_be_passive_in_part(tmp_path: Path) -> None:
    active, passive = "The clock settles it.\n", "It is settled by the clock.\n"
    few = int(STYLE.passive_from * STYLE.passive_percent / 100)
    assert faults(tmp_path, active * (STYLE.passive_from - few) + passive * few) == []
    (fault,) = faults(tmp_path, active * (STYLE.passive_from - few - 1) + "\n" + passive * (few + 1))
    assert f"{few + 1} of {STYLE.passive_from} sentences are passive" in fault
    assert faults(tmp_path, passive * (STYLE.passive_from - 1)) == []


def test_first_lines_of_docstrings_are_checked(tmp_path: Path) -> None:
    file = tmp_path / "module.py"
    lines = [
        '"""Read the market.',
        "",
        'Told of it."""',
        "def price() -> float:",
        '    """What everybody said."""',
        "    return 1.0",
    ]
    file.write_text("\n".join(lines), encoding="utf-8")
    assert [(fault.line, fault.message.partition(":")[0]) for fault in prose.check_docstrings(file, STYLE)] == [
        (5, '"everybody"'),
        (5, 'docstring begins with "What"; name the thing or the act'),
    ]


def test_a_folder_stands_for_its_pages_and_modules(tmp_path: Path) -> None:
    for name in ("page.md", "module.py", "data.txt"):
        (tmp_path / name).write_text('"""The twin runs."""\n')
    assert sorted(fault.path.name for fault in prose.check([tmp_path], STYLE)) == ["module.py", "page.md"]


def test_the_command_prints_faults_and_fails(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.md", tmp_path / "bad.md"
    good.write_text("All is fine.\n")
    bad.write_text("# One\n\nThe twin runs.\n")
    command = [sys.executable, str(ROOT / "tools" / "prose.py")]
    assert subprocess.run([*command, str(good)], timeout=60).returncode == 0
    ended = subprocess.run([*command, str(good), str(bad)], capture_output=True, text=True, timeout=60)
    assert ended.returncode == 1
    assert ended.stdout.splitlines() == [f'{bad}:3: "twin": write baseline, second session, or over the memory limit']
