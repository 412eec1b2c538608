"""What an agent process must not load: describing a home needs pydantic and numpy alone."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("pandas", "scipy", "pvlib", "pyarrow", "typer", "rich")


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("from zengrid.scenario import HomeSpec, homes_params", (*HEAVY, "yaml", "zengrid.scenario.scenario")),
        ("from zengrid.scenario import load; load('paper').days().day(0)", HEAVY),
        ("from zengrid.scenario import load; load('village').days().day(0)", HEAVY),
    ],
)
def test_no_more_is_imported_than_needed(statement: str, absent: tuple[str, ...]) -> None:
    script = f"{statement}\nimport sys\nprint([name for name in {absent!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    assert done.stdout == "[]\n"
