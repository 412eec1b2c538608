"""Values of options are parsed with their limits, and refused with what is permitted."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import pytest

from zengrid.command_line.assignments import parse_assignments
from zengrid.command_line.value_parsers import Number, WholeNumber, parse_integer, parse_speed
from zengrid.errors import PolicyError


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (parse_speed, "max", 0.0), (parse_speed, "60x", 60.0), (parse_speed, "0.5", 0.5), (parse_integer, "-3", -3),
        (WholeNumber(1), "1", 1), (WholeNumber(0, 9), "9", 9), (Number(), "0", 0.0), (Number(), "1e3", 1000.0),
        (Number(above=True, high=3600.0, unit="s"), "3600", 3600.0),
    ],
)  # fmt: skip
def test_values(parse: Callable[[str], float], text: str, value: float) -> None:
    assert parse(text) == value


@pytest.mark.parametrize(
    ("parse", "texts", "permitted"),
    [
        (parse_speed, ["0", "-1x", "fast", "nan", "2e9x"], "max, or a factor on real time such as 60x, 1x or 0.5x"),
        (parse_integer, ["1.5", "x"], "a whole number"),
        (WholeNumber(1), ["0", "-1", "1.0", "x", "", "²"], "a whole number from 1 up"),
        (WholeNumber(1, 65535), ["0", "65536"], "a whole number 1 to 65535"),
        (Number(unit="kW"), ["-1", "nan", "inf", "x"], "a number from 0 kW up"),
        (Number(above=True, unit="s"), ["0", "-1", "inf"], "a number above 0 s"),
        (Number(above=True, high=3600.0, unit="s"), ["0", "3601"], "a number above 0 up to 3600 s"),
    ],
)
def test_other_values_are_refused(parse: Callable[[str], float], texts: list[str], permitted: str) -> None:
    for text in texts:
        with pytest.raises(argparse.ArgumentTypeError) as refused:
            parse(text)
        assert str(refused.value) == f"permitted: {permitted}"


def test_assignments_are_read_as_yaml() -> None:
    texts = ["lr=1e-3", "steps=240", "soc_reset=never", "hidden=[8, 8]", "initial=null", "path=a=b"]
    assert parse_assignments(texts) == {
        "lr": 1e-3, "steps": 240, "soc_reset": "never", "hidden": (8, 8), "initial": None, "path": "a=b",
    }  # fmt: skip
    with pytest.raises(PolicyError, match="steps: permitted: NAME=VALUE"):
        parse_assignments(["steps"])


def test_the_presets_of_the_command_line_are_those_of_training() -> None:
    from zengrid.learn.settings import _PRESETS
    from zengrid_cli.command_table import load_parser

    for command in ("train", "sweep", "reproduce"):
        preset = next(it for it in load_parser(command).arguments() if it.dest == "preset")
        assert set(preset.choices or ()) == set(_PRESETS)
