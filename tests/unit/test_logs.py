"""Sentences for a person by default; structured lines, by level, where they are asked for."""

from __future__ import annotations

import json
import subprocess
import sys
import threading

import pytest

from zengrid import logs
from zengrid.command_line.command_parser import CommandParser
from zengrid.command_line.log_options import add_log_options


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logs, "_log", logs._Log())
    for name in ("ZENGRID_LOG", "ZENGRID_LOG_LEVEL"):
        monkeypatch.delenv(name, raising=False)
    for module, name in ((sys, "excepthook"), (threading, "excepthook")):
        monkeypatch.setattr(module, name, getattr(module, name))


def begin(*words: str) -> None:
    parser = CommandParser()
    add_log_options(parser)
    logs.configure("clock", parser.parse_args(words), run="main")


def tell() -> None:
    logs.print_message("waiting: disk full", "warning", day=1, slot=2)
    logs.log_event("info", "agent is away", day=3, slot=4, agent="p1", before="present")
    logs.log_event("debug", "fallback", agent="p1")
    logs.print_error("port = x: permitted: 1 to 65535")


def test_by_default_a_person_reads_sentences_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    begin()
    tell()
    said = capsys.readouterr().err.splitlines()
    assert said == ["zengrid clock: waiting: disk full", "zengrid clock: port = x: permitted: 1 to 65535"]


def test_a_lower_level_adds_lines_of_keys_and_values(capsys: pytest.CaptureFixture[str]) -> None:
    begin("--log-level", "info")
    tell()
    sentence, line, _ = capsys.readouterr().err.splitlines()
    assert sentence == "zengrid clock: waiting: disk full"
    expected = 'level=info service=clock run=main day=3 slot=4 agent=p1 event="agent is away" before=present'
    assert line.partition(" ")[2] == expected


def test_json_holds_all_that_is_told(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENGRID_LOG", "json")
    monkeypatch.setenv("ZENGRID_LOG_LEVEL", "debug")
    begin()
    tell()
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [line["level"] for line in lines] == ["warning", "info", "debug", "error"]
    assert {line["run"] for line in lines} == {"main"}
    assert (lines[1]["day"], lines[1]["slot"], lines[1]["agent"]) == (3, 4, "p1")
    try:
        raise ValueError("two\nlines")
    except ValueError:
        sys.excepthook(*sys.exc_info())
    crash = json.loads(capsys.readouterr().err)
    assert (crash["level"], crash["run"]) == ("error", "main")
    assert "Traceback" in crash["exception"]


@pytest.mark.parametrize("words", [("--log", "xml"), ("--log-level", "loud")])
def test_what_is_unknown_is_refused_with_what_is_permitted(
    words: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        begin(*words)
    assert f"= {words[1]}: unknown; permitted: " in capsys.readouterr().err


def test_structlog_is_loaded_only_where_it_is_asked_for() -> None:
    script = "import sys, zengrid_agent.__main__ as a; from zengrid import logs; {}; print('structlog' in sys.modules)"
    begins = (
        "logs.configure('grid', a.parser().parse_args(['grid'{}])); "
        "logs.log_event('info', 'x'); logs.print_message('y')"
    )
    for words, loaded in (("", "False"), (", '--log', 'json'", "True")):
        code = script.format(begins.format(words))
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == loaded


HOSTILE = "\x1b[2J\x07red\r\x00\x9b\x7f\u202e\ud800\U000e0001"
SHOWN = r"\u001b[2J\u0007red\u000d\u0000\u009b\u007f\u202e\ud800\udb40\udc01"


def tell_hostile() -> None:
    logs.print_message(f"policy = {HOSTILE}")
    logs.print_error(f"policy = {HOSTILE}")
    logs.log_event("error", HOSTILE, agent=HOSTILE, why=(HOSTILE,))
    try:
        raise ValueError(HOSTILE)
    except ValueError as error:
        logs.print_unexpected("in a test", error)
        sys.excepthook(*sys.exc_info())
        threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), None)))


@pytest.mark.parametrize("words", [(), ("--log", "json")], ids=["text", "json"])
def test_nothing_from_outside_reaches_a_terminal_as_a_command(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    begin(*words)
    tell_hostile()
    said = capsys.readouterr().err
    assert all(line.isprintable() for line in said.split("\n"))
    if words:
        assert [HOSTILE in json.loads(line)["event"] for line in said.splitlines()] == [True] * 6
    else:
        assert said.count(SHOWN) == 8  # three of them in the last lines of tracebacks


def test_a_text_of_several_lines_cannot_pass_for_several_events(capsys: pytest.CaptureFixture[str]) -> None:
    begin()
    logs.print_message("policy = x\nzengrid clock: all is well\n  indented")
    assert capsys.readouterr().err.splitlines() == [
        "zengrid clock: policy = x", "  zengrid clock: all is well", "  indented",
    ]  # fmt: skip
    logs.log_event("error", "one\ntwo", agent="p1\nlevel=error")
    (line,) = capsys.readouterr().err.splitlines()
    assert r"one\ntwo" in line
    assert r"p1\nlevel=error" in line


def test_a_thread_that_ends_itself_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    begin()
    thread = threading.Thread(target=sys.exit)
    thread.start()
    thread.join()
    assert capsys.readouterr().err == ""


def test_texts_are_left_as_they_are_where_they_can_be_shown() -> None:
    for text in ("", "bill = -3.21 $", "größer als 5 kW ☀", "two\nlines"):
        assert logs.printable(text) == text
