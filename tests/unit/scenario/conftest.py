"""What the scenario tests share: measured data where it is there, and scenarios in files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from zengrid.scenario import Scenario, load

ROOT = Path(__file__).parents[3]

MARKET = """\
name: mine
tariff:
  - {from: "00:00", price: 0.1}
facilities:
  - {name: base, max_kw: 100, b: 0.03}
homes:
  - {id: a, load: {profile: a}}
"""


@pytest.fixture(scope="session")
def paper() -> Scenario:
    return load("paper")


@pytest.fixture(scope="session")
def fontana() -> Path:
    folder = Path(os.environ.get("ZENGRID_FONTANA", ROOT.parent / "shared" / "data" / "fontana_homes"))
    if not folder.is_dir():
        pytest.skip(f"no measured homes at {folder}; ZENGRID_FONTANA names another folder")
    return folder


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    def write_file(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


@pytest.fixture
def on_csv(write: Callable[[str, str], Path]) -> Callable[..., Scenario]:
    """A market of one home that plays the CSV text it is given."""

    def scenario(text: str, more: str = "", data: str = "") -> Scenario:
        write("data.csv", text)
        path = write("market.yaml", f"{MARKET}data: {{kind: csv, path: data.csv{data}}}\n{more}")
        return load(path)

    return scenario
