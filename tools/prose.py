"""Check the prose of Markdown pages and of docstrings against the style in ``prose.toml``.

``python tools/prose.py`` checks everything the style names; ``python tools/prose.py PATH ...`` checks only these files
and folders. Each fault is one line, ``path:line: message``. The exit code is 1 if there are any. Nothing is downloaded.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
STYLE = Path(__file__).with_name("prose.toml")

_FENCE = re.compile(r"^\s*(```|~~~)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")
_UNBREAKABLE = 60  # characters of a token that leaves no room for a line break
_ABBREVIATIONS = r"(?<!\be\.g)(?<!\bi\.e)(?<!\bcf)(?<!\beq)(?<!\bFig)(?<!\bno)(?<!\b[A-Z])"
_SENTENCE_END = re.compile(_ABBREVIATIONS + r"[.!?][\"')*_]*\s+(?=[\"'(*_]*(?:[A-Z0-9]|zengrid\b|code\b))")
_PARTICIPLES = (
    "begun|bound|broken|brought|built|caught|chosen|cut|done|drawn|driven|fed|forgotten|found|given|gone|heard|held|hidden|"
    "kept|known|learnt|left|lost|made|meant|met|paid|put|read|run|seen|sent|set|shown|shut|sold|spent|split|stolen|taken|"
    "taught|thought|told|understood|won|written"
)
_PASSIVE = re.compile(
    rf"\b(?:am|is|are|was|were|be|been|being)\s+(?:(?:not|never|always|also|only|then|still|often)\s+|\w+ly\s+)?"
    rf"(?:\w{{2,}}ed|{_PARTICIPLES})\b",
    re.IGNORECASE,
)


class Fault(NamedTuple):
    """One place that breaks a rule."""

    path: Path
    line: int
    message: str

    def __str__(self) -> str:
        path = self.path.relative_to(ROOT) if self.path.is_relative_to(ROOT) else self.path
        return f"{path}:{self.line}: {self.message}"


class Sentence(NamedTuple):
    """A sentence without markup, and the line on which its paragraph begins."""

    line: int
    text: str

    @property
    def words(self) -> int:
        """Number of tokens with a letter or digit."""
        return sum(any(char.isalnum() for char in token) for token in self.text.split())


@dataclass(frozen=True)
class Style:
    """The rules, as read from a TOML file."""

    pages: tuple[str, ...]
    generated: tuple[str, ...]
    """Pages that a tool writes: their text stands in the code, which is not checked here."""
    docstrings: tuple[str, ...]
    columns: int
    words: int
    passive_percent: float
    passive_from: int
    docstring_starts: tuple[str, ...]
    phrases: tuple[tuple[re.Pattern[str], str], ...]
    spellings: dict[str, str]

    @classmethod
    def load(cls, path: Path = STYLE) -> Style:
        """Read the style from a file."""
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        phrases = {**data["phrases"], **data["terms"]["instead"]}
        return cls(
            pages=tuple(data["pages"]),
            generated=tuple(data["generated"]),
            docstrings=tuple(data["docstrings"]),
            columns=data["columns"],
            words=data["words"],
            passive_percent=data["passive_percent"],
            passive_from=data["passive_from"],
            docstring_starts=tuple(data["docstring_starts"]),
            phrases=tuple(
                (re.compile(rf"\b(?:{pattern})(?!\w)", re.IGNORECASE), advice) for pattern, advice in phrases.items()
            ),
            spellings={term.lower(): term for term in data["terms"]["spellings"]},
        )


def check_page(path: Path, style: Style) -> Iterator[Fault]:
    """Check one Markdown page."""
    text = path.read_text(encoding="utf-8")
    for number, line in prose_lines(text):
        if too_wide(line, style.columns):
            yield Fault(path, number, f"line of {len(line)} columns; at most {style.columns}")
    sentences = [sentence for block in blocks(text) for sentence in split(*block)]
    for sentence in sentences:
        yield from check_sentence(path, sentence, style)
        if sentence.words > style.words:
            yield Fault(
                path, sentence.line, f"sentence of {sentence.words} words; at most {style.words}: {sentence.text}"
            )
    full = [sentence for sentence in sentences if sentence.text.endswith((".", "!", "?", ":"))]
    passive = [sentence for sentence in full if _PASSIVE.search(sentence.text)]
    if len(full) >= style.passive_from and 100 * len(passive) > style.passive_percent * len(full):
        yield Fault(
            path,
            passive[0].line,
            f"{len(passive)} of {len(full)} sentences are passive; at most {style.passive_percent} %. "
            f"Passive on lines {', '.join(str(sentence.line) for sentence in passive)}",
        )


def check_docstrings(path: Path, style: Style) -> Iterator[Fault]:
    """Check the first line of each docstring of a Python file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        docstring = ast.get_docstring(node)
        if not docstring:
            continue
        first = Sentence(node.body[0].lineno, plain(docstring.splitlines()[0]))
        yield from check_sentence(path, first, style)
        for start in style.docstring_starts:
            if first.text.startswith(start):
                yield Fault(path, first.line, f'docstring begins with "{start.strip()}"; name the thing or the act')


def check_sentence(path: Path, sentence: Sentence, style: Style) -> Iterator[Fault]:
    """Check phrases, terms and word order of one sentence."""
    for pattern, advice in style.phrases:
        if found := pattern.search(sentence.text):
            yield Fault(path, sentence.line, f'"{found[0]}": write {advice}')
    for word in re.findall(r"(?<![\w/.@-])[A-Za-z][\w-]*", sentence.text):
        term = style.spellings.get(word.lower())
        if term is not None and word != term and sentence.words > 1:  # a word alone may be a value, as in a table
            yield Fault(path, sentence.line, f'"{word}": spelled {term}')
    if sentence.text.startswith("Who ") and sentence.text.endswith("."):
        yield Fault(path, sentence.line, 'a statement begins with "Who": put the subject first')


def prose_lines(text: str) -> Iterator[tuple[int, str]]:
    """Number and text of each line outside fenced code."""
    fence = ""
    for number, line in enumerate(text.splitlines(), 1):
        mark = _FENCE.match(line)
        if mark and fence in ("", mark[1]):
            fence = "" if fence else mark[1]
        elif not fence:
            yield number, line


def too_wide(line: str, columns: int) -> bool:
    """Whether a line is longer than permitted and could be broken."""
    if len(line) <= columns or line.lstrip().startswith(("|", "#", "!", "[!", "<")):
        return False
    return max(map(len, line.split())) < _UNBREAKABLE


def blocks(text: str) -> Iterator[tuple[int, str]]:
    """First line and text of each paragraph, list item, heading and table cell, without markup."""
    begin, parts = 0, list[str]()
    for number, line in [*prose_lines(re.sub(r"<!--.*?-->", _blank, text, flags=re.DOTALL)), (0, "")]:
        alone = line.lstrip().startswith(("#", "|"))
        if parts and (not line.strip() or alone or _ITEM.match(line) or number != begin + len(parts)):
            yield begin, plain(" ".join(parts))
            parts = []
        if alone:
            yield from ((number, plain(cell)) for cell in line.split("|") if re.search(r"\w", cell))
        elif line.strip():
            begin = begin if parts else number
            parts.append(line)
    if parts:
        yield begin, plain(" ".join(parts))


def _blank(found: re.Match[str]) -> str:
    """Keep the line breaks of what is left out."""
    return "\n" * found[0].count("\n")


def plain(text: str) -> str:
    """Remove markup; code becomes the word ``code``."""
    text = _ITEM.sub("", text).lstrip("#> ")
    text = re.sub(r"(`+)(?!`).+?(?<!`)\1(?!`)", "code", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"<[^>]+>|https?://\S+", "", text)
    text = re.sub(r"\{[^}]*\}$", "", text)
    return " ".join(re.sub(r"[*_]{1,3}(?=\S)|(?<=\S)[*_]{1,3}", "", text).split())


def split(line: int, text: str) -> Iterator[Sentence]:
    """Split a block into sentences."""
    begin = 0
    for end in _SENTENCE_END.finditer(text):
        yield Sentence(line, text[begin : end.end()].strip())
        begin = end.end()
    if begin < len(text):
        yield Sentence(line, text[begin:])


def check(paths: list[Path], style: Style) -> list[Fault]:
    """Check files by their kind, and all files of folders; without any path, all that the style names."""
    if not paths:
        generated = {ROOT / page for page in style.generated}
        paths = [path for pattern in style.pages for path in sorted(ROOT.glob(pattern)) if path not in generated]
        paths += [ROOT / package for package in style.docstrings]
    faults: list[Fault] = []
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix == ".md":
                faults += check_page(file, style)
            elif file.suffix == ".py":
                faults += check_docstrings(file, style)
    return faults


def main(arguments: list[str]) -> int:
    """Print the faults of files; return the exit code."""
    faults = check([Path(argument).resolve() for argument in arguments], Style.load())
    for fault in faults:
        print(fault)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
