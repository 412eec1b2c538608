"""Tokens: made once, kept as hashes, refused when guessed."""

from __future__ import annotations

from pathlib import Path

import pytest

from zengrid.bus.addresses import is_loopback
from zengrid.errors import ZengridError
from zengrid_gateway.settings import Settings
from zengrid_gateway.tokens import Tokens


def test_made_at_the_first_start(tmp_path: Path) -> None:
    path = tmp_path / "state" / "tokens.json"
    tokens, made = Tokens.load(path)
    assert set(made) == {"read", "operate"}
    assert tokens.role(made["operate"]) == "operate"
    assert tokens.role(made["read"]) == "read"
    assert tokens.role(made["read"] + "x") is None
    again, shown = Tokens.load(path)
    assert shown == {}
    assert again.role(made["operate"]) == "operate"
    assert not any(token in path.read_text() for token in made.values())


@pytest.mark.parametrize("text", ["", "{", "[]", '{"abc": "king"}'])
def test_a_file_that_is_no_token_file(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tokens.json"
    path.write_text(text)
    with pytest.raises(ZengridError, match="sha256"):
        Tokens.load(path)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "::1", "127.1.2.3"])
def test_loopback_addresses_are_recognized(host: str) -> None:
    assert is_loopback(host)
    assert Settings(host=host).protected == "nothing"
    assert Settings(host=host).rate_per_s == 0


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "example.org"])
def test_writing_is_protected_beyond_this_machine(host: str) -> None:
    assert not is_loopback(host)
    assert Settings(host=host).protected == "writing"
    assert Settings(host=host).rate_per_s == 100
