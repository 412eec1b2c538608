"""``zengrid scenario``: what people see, and exit codes."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.commands import run_zengrid


@pytest.mark.parametrize("name", ["paper", "village"])
def test_show_describes_a_market(name: str) -> None:
    result = run_zengrid("scenario", "show", name)
    assert result.exit_code == 0, result.stderr
    for word in (name, "import price", "0.05 from 00:00, 0.095 from 11:00", "homes", "reserve", "█", "kWh"):
        assert word in result.stdout


def test_show_says_how_many_homes_are_not_shown() -> None:
    assert "and 88 more" in run_zengrid("scenario", "show", "village").stdout


def test_show_measured_homes(fontana: Path) -> None:
    result = run_zengrid("scenario", "show", "fontana", "--data", str(fontana), "--day", "40")
    assert result.exit_code == 0, result.stderr
    assert "364, Mon 1 Aug to Sun 30 Jul" in result.stdout
    assert "Sat 10 Sep" in result.stdout


def test_check_passes_what_is_fine() -> None:
    result = run_zengrid("scenario", "check", "paper")
    assert (result.exit_code, result.stdout) == (0, "paper is fine: 3 homes, 24 slots a day, a typical day\n")


def test_check_tells_all_faults(tmp_path: Path) -> None:
    path = tmp_path / "market.yaml"
    path.write_text("name: mine\nseed: -1\nfoo: 2\n")
    result = run_zengrid("scenario", "check", str(path))
    assert result.exit_code == 1
    for part in ("line 2: seed = -1", "line 3: foo: there is no such field", "tariff: missing", "facilities: missing"):
        assert part in result.stderr


def test_check_looks_into_the_data(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("time,a_load_kw\n" + "".join(f"{h:02d}:00,{h - 7}\n" for h in range(24)))
    path = tmp_path / "market.yaml"
    path.write_text(
        "name: x\ntariff: [{from: 00:00, price: 1}]\nfacilities: [{name: b, max_kw: 9, b: 1}]\n"
        "homes: [{id: a}]\ndata: {kind: csv, path: data.csv}\n"
    )
    result = run_zengrid("scenario", "check", str(path))
    assert result.exit_code == 1
    assert 'data.csv, line 2, column "a_load_kw": -7 is out of range; permitted: a number from 0 up' in result.stderr


def test_fontana_without_data_tells_where_it_is() -> None:
    result = run_zengrid("scenario", "check", "fontana")
    assert result.exit_code == 1
    assert "CityLearn Challenge 2022" in result.stderr


def test_export_writes_files_that_check(tmp_path: Path) -> None:
    result = run_zengrid("scenario", "export", "paper", "--days", "3", "--out", str(tmp_path))
    assert result.exit_code == 0, result.stderr
    assert result.stdout.split() == [str(tmp_path / "profiles.csv"), str(tmp_path / "scenario.yaml")]
    again = run_zengrid("scenario", "check", str(tmp_path / "scenario.yaml"))
    assert again.stdout == "paper is fine: 3 homes, 24 slots a day, 3 measured days\n"


def test_export_refuses_what_it_cannot_write() -> None:
    result = run_zengrid("scenario", "export", "paper", "--out", "/dev/null/x")
    assert result.exit_code == 1
    assert "cannot be written to" in result.stderr
