"""Fenced blocks of the documentation, to be executed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
_FENCE = re.compile(r"^```(\w+)(?: title=\"([^\"]*)\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """One fenced block of a page."""

    language: str
    title: str
    text: str
    line: int
    shown: str | None
    """The ``text`` block that follows with nothing in between: what the block prints."""


def blocks(page: str, *languages: str) -> Iterator[Block]:
    """Blocks of some languages, in order; ``page`` is a path from the project's root."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = list(_FENCE.finditer(text))
    for this, after in zip_longest(found, found[1:]):
        if this[1] not in languages:
            continue
        follows = after is not None and after[1] == "text" and not text[this.end() : after.start()].strip()
        shown = after[3] if after is not None and follows else None
        yield Block(this[1], this[2] or "", this[3], text.count("\n", 0, this.start(3)), shown)
