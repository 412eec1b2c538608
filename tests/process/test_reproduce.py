"""``zengrid reproduce`` and ``zengrid sweep`` as a user runs them: stopped, gone on with, and read."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from zengrid.testing import Process

pytest.importorskip("torch", reason="extra learn is not installed")

DEADLINE_S = 300.0
TINY = ["days=2", "pool=8", "steps=240", "memory=200", "hidden=[8]", "batch=4"]
SET = [word for change in TINY for word in ("--set", change)]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(2 * DEADLINE_S)]


def zengrid(*words: str, code: int = 0) -> str:
    ended = subprocess.run(
        [sys.executable, "-m", "zengrid_cli", *words], capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert ended.returncode == code, ended.stdout + ended.stderr
    return ended.stdout + ended.stderr


def wait_for(folder: Path, pattern: str, process: Process) -> None:
    until = time.monotonic() + DEADLINE_S
    while not list(folder.glob(pattern)):
        assert process.popen.poll() is None, process.output()
        assert time.monotonic() < until, f"no {pattern} in {folder}\n{process.output()}"
        time.sleep(0.05)


class Report(HTMLParser):
    """Numbers of each row of the tables, and figures with a drawing in them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: dict[tuple[str | None, str | None], list[tuple[float, str]]] = {}
        self.drawn: list[str] = []
        self.outside: list[str] = []
        self._row: list[tuple[float, str]] = []
        self._value: float | None = None
        self._figure = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = dict(attributes)
        if tag == "tr":
            self._row = self.rows.setdefault((given.get("data-agent"), given.get("data-figure")), [])
        elif tag == "data":
            self._value = float(given["value"] or "")
        elif tag == "figure":
            self._figure = given["id"] or ""
        elif tag == "svg":
            self.drawn.append(self._figure)
        address = given.get("src") or (given.get("href") if tag == "link" else None)
        if address:
            self.outside.append(address)

    def handle_endtag(self, tag: str) -> None:
        if tag == "tr":
            self._row = []

    def handle_data(self, data: str) -> None:
        if self._value is not None:
            self._row.append((self._value, data))
            self._value = None


def three(values: dict[str, float | None]) -> list[float]:
    """What the report shows of a spread."""
    names = ["median"] if values["min"] == values["max"] else ["median", "min", "max"]
    return [value for value in map(values.get, names) if value is not None]


def shown(entry: dict[str, Any]) -> list[float]:
    """The numbers of one row, in order."""
    bounds = [] if entry["figure"] != "bill" else three(entry["best_response_percent"]) + three(entry["gap_percent"])
    return [
        entry["paper_percent"], *three(entry["change_percent"]), entry["leader_percent"], *bounds,
        entry["conventional"], *three(entry["agents"]), entry["leader"],
    ]  # fmt: skip


def test_a_reproduction_is_stopped_and_goes_on_to_its_report(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    words = ["reproduce", "--out", str(folder), "--seeds", "2", "--capacities", "6", "--days", "1", "--jobs", "2", *SET]
    process = Process("reproduce", [sys.executable, "-m", "zengrid_cli", *words], tmp_path, {})
    wait_for(folder, "jobs/*/training.checkpoint", process)
    process.popen.send_signal(signal.SIGINT)
    assert process.popen.wait(DEADLINE_S) == 130, process.output()
    assert f"To continue: zengrid reproduce --out {folder}" in process.output()
    assert not (folder / "report.html").exists()
    before = {path: path.stat().st_mtime_ns for path in folder.glob("jobs/*/result.json")}

    said = zengrid(*words)
    assert f"{4 - len(before)} jobs left" in said
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())
    results = json.loads((folder / "results.json").read_text())
    report = Report((folder / "report.html").read_text())
    assert report.outside == []  # it needs nothing beside it
    assert len(results["figures"]) == 5
    for entry in results["figures"]:
        numbers = report.rows[entry["agent"], entry["figure"]]
        assert [value for value, _ in numbers] == shown(entry)
        for value, text in numbers:
            digits = text.removesuffix("%").strip()
            assert abs(float(digits) - value) <= 0.5001 * 10.0 ** -len(digits.partition(".")[2])
    assert len(report.drawn) == 7
    for name in report.drawn:
        assert (folder / "figures" / f"{name}.png").stat().st_size > 10_000
        assert (folder / "figures" / f"{name}.svg").stat().st_size < 300_000
        assert len(pd.read_csv(folder / "figures" / f"{name}.csv")) > 0
    assert results["seeds"] == [0, 1]
    assert results["command"].startswith("zengrid reproduce --out")
    assert "0 jobs left" in zengrid(*words)


def test_a_sweep_over_processes_comes_to_the_same_in_any_number_of_them(tmp_path: Path) -> None:
    words = ["sweep", "paper", "--vary", "soc_reset=daily,never", "--seeds", "2", "--days", "7", *SET]
    said = zengrid(*words, "--out", str(tmp_path / "one"), "--jobs", "1")
    assert "2 soc_reset x 2 seeds: 4 markets; 2 jobs" in said
    zengrid(*words, "--out", str(tmp_path / "two"), "--jobs", "2")
    one, two = (pd.read_parquet(tmp_path / name / "table.parquet") for name in ("one", "two"))
    pd.testing.assert_frame_equal(one, two)
    assert (tmp_path / "one" / "figures" / "sweep.svg").exists()
    for policy in json.loads((tmp_path / "one" / "sweep.json").read_text())["policies"]:
        assert (tmp_path / "one" / policy["folder"] / policy["grid"]).exists()
    said = zengrid("sweep", "--vary", "homes.*.battery.capacity=3", "--out", str(tmp_path / "no"), code=1)
    assert "there is no such field; permitted: capacity_kwh" in said
    assert not (tmp_path / "no").exists()


def test_a_sweep_on_a_ray_cluster_comes_to_the_same(tmp_path: Path) -> None:
    pytest.importorskip("ray", reason="extra cluster is not installed")
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        words = ["sweep", "paper", "--vary", "lr=1e-3,1e-4", "--seeds", "1", "--days", "4", *SET]
        zengrid(*words, "--out", str(tmp_path / "there"), "--cluster", cluster.address)
    finally:
        cluster.shutdown()
    zengrid(*words, "--out", str(tmp_path / "here"), "--jobs", "2")
    here, there = (pd.read_csv(tmp_path / name / "table.csv") for name in ("here", "there"))
    pd.testing.assert_frame_equal(here, there)
