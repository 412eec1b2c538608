"""What an agent process must not load: describing a home needs pydantic and numpy alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from zengrid.scenario import dumps, load
from zengrid.testing import free_endpoint

HEAVY = ("pandas", "scipy", "pvlib", "pyarrow", "typer", "rich")


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("from zengrid.scenario import HomeSpec, homes_params", (*HEAVY, "yaml", "zengrid.scenario.scenario")),
        ("from zengrid.scenario import Days, load; Days(load('paper')).day(0)", HEAVY),
        ("from zengrid.scenario import Days, load; Days(load('village')).day(0)", HEAVY),
    ],
)
def test_no_more_is_imported_than_needed(statement: str, absent: tuple[str, ...]) -> None:
    script = f"{statement}\nimport sys\nprint([name for name in {absent!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=30)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize("name", ["pandas", "scipy"])
def test_the_small_image_says_what_a_new_site_needs(name: str, tmp_path: Path) -> None:
    """A clock as in an image that lacks one of them, at a place that no cache knows."""
    village = load("village")
    assert village.site is not None
    elsewhere = village.site.model_copy(update={"latitude": 40.0})
    (tmp_path / "mine.yaml").write_text(dumps(village.model_copy(update={"site": elsewhere})))
    words = ["clock", "mine.yaml", "--listen", free_endpoint(), "--journal", "z.db", "--wait", "0", "--days", "1"]
    script = f"import sys; sys.modules[{name!r}] = None; from zengrid_cli.__main__ import main; sys.exit(main({words}))"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert f"zengrid clock: site: {name} is not installed; needed" in done.stderr
    assert "pip install pandas pvlib scipy" in done.stderr
    assert "Traceback" not in done.stderr
