"""Log files stay small, and the last words of a process are found in them."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from zengrid.processes.process_log import (
    MAX_BYTES,
    append_line,
    limit_log,
    log_size,
    make_log_folder,
    read_last_lines,
    start_log,
)


def test_a_log_that_grew_too_large_is_set_aside_while_its_writer_goes_on(tmp_path: Path) -> None:
    log = tmp_path / "clock.log"
    with log.open("ab", buffering=0) as writer:
        writer.write(b"x" * MAX_BYTES)
        assert not limit_log(log)
        writer.write(b"the end\n")
        assert limit_log(log)
        writer.write(b"a new beginning\n")
    assert log.read_bytes() == b"a new beginning\n"
    aside = (tmp_path / "clock.log.1").read_bytes()
    assert len(aside) == MAX_BYTES
    assert aside.endswith(b"the end\n")


def test_the_tail_quotes_only_the_present_life(tmp_path: Path) -> None:
    log = tmp_path / "p1.log"
    log.write_text("an earlier life\n")
    since = start_log(log)
    with log.open("a") as writer:
        writer.write("one\n\ntwo\nthree\n")
    assert read_last_lines(log, since) == ["one", "two", "three"]
    assert read_last_lines(log, since, lines=2) == ["two", "three"]
    assert read_last_lines(log)[0] == "an earlier life"
    assert re.fullmatch(r"--- [-0-9]+ [:0-9]+ started", read_last_lines(log)[1])


def test_of_a_structured_line_the_tail_quotes_what_happened(tmp_path: Path) -> None:
    log = tmp_path / "p1.log"
    log.write_text('{"level": "error", "event": "policy = x: unknown"}\n{"odd": 1}\n{no object\n')
    assert read_last_lines(log) == ["policy = x: unknown", '{"odd": 1}', "{no object"]


def test_a_log_that_was_never_written_is_empty(tmp_path: Path) -> None:
    assert log_size(tmp_path / "none.log") == 0
    assert read_last_lines(tmp_path / "none.log") == []
    assert not limit_log(tmp_path / "none.log")


def test_bytes_that_are_no_text_are_shown_anyhow(tmp_path: Path) -> None:
    log = tmp_path / "odd.log"
    log.write_bytes(b"caf\xe9\n")
    assert read_last_lines(log) == ["caf\N{REPLACEMENT CHARACTER}"]


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_only_their_owner_can_read_logs(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "main"
    make_log_folder(folder)
    make_log_folder(folder)
    assert mode(folder) == 0o700
    log, old = folder / "p1.log", folder / "old.log"
    old.write_text("of an earlier version\n")
    old.chmod(0o644)
    for path in (log, old):
        start_log(path)
        append_line(path, "x" * MAX_BYTES)
        assert limit_log(path)
        assert (mode(path), mode(path.with_name(path.name + ".1"))) == (0o600, 0o600)
    open_to_all = tmp_path / "shared"
    open_to_all.mkdir()
    open_to_all.chmod(0o755)
    make_log_folder(open_to_all)
    assert mode(open_to_all) == 0o755  # somebody's choice


def test_the_tail_shows_no_control_characters(tmp_path: Path) -> None:
    log = tmp_path / "p1.log"
    log.write_text('\x1b[31mred\n{"event": "\\u001b[2J\\ud800"}\n{"event": ' + "[" * 10_000 + "\n")
    red, cleared, deep = read_last_lines(log)
    assert (red, cleared) == (r"\u001b[31mred", r"\u001b[2J\ud800")
    assert deep.startswith('{"event": [[')
