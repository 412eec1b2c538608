"""The summary adds up what the journal holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.journal_records import DT_H, begin, fill, record, roster
from zengrid.journal import Journal
from zengrid_cli.report.run_results import ComparedSum, add_up_run, latest_run
from zengrid_cli.report.run_summary import print_summary


def test_sums_over_a_run_whose_homes_change(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        run = begin(journal)
        settled = fill(run, 3, 30)
        for position in range(30, 40):
            settled.append(record(2, position, version=2))
            run.commit(settled[-1], roster(2, version=2, first=2) if position == 30 else None)
        found = add_up_run(run)
    assert found.slots == 40
    assert list(found.bills) == ["h0", "h1", "h2", "h3"]
    assert found.bills["h0"].real == pytest.approx(sum(it.bill[0] for it in settled[:30]))
    h2 = sum(it.bill[2] for it in settled[:30]) + sum(it.bill[0] for it in settled[30:])
    assert found.bills["h2"].real == pytest.approx(h2)
    assert found.all_bills.baseline == pytest.approx(sum(it.baseline_bill.sum() for it in settled))
    assert found.fallbacks["h1"] == sum(bool(it.fallback[1]) for it in settled[:30])
    assert found.grid_fallbacks == sum(it.grid_fallback for it in settled)
    assert found.profit.real == pytest.approx(sum(it.profit for it in settled))
    assert found.reserve.real == pytest.approx(DT_H * sum(it.facility_kw[1:].sum() for it in settled))
    assert found.unserved_kwh == pytest.approx(DT_H * sum(it.unserved_kw + it.home_unserved_kw for it in settled))
    assert found.first_settled_at == settled[0].settled_at


@pytest.mark.parametrize(
    ("real", "baseline", "percent"), [(62.0, 100.0, -38.0), (-3.0, -2.0, -50.0), (5.0, 0.001, None)]
)
def test_a_difference_is_given_in_dollars_and_percent(real: float, baseline: float, percent: float | None) -> None:
    assert ComparedSum(real, baseline).percent == (None if percent is None else pytest.approx(percent))
    assert ComparedSum(real, baseline).difference == real - baseline


def test_the_last_run_of_a_market_is_meant(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        for name in ("main-1", "other-1", "main-2", "main-extra-1"):
            begin(journal, name).close()
        found = latest_run(journal, "main")
        assert found is not None
        assert found.name == "main-2"
        assert latest_run(journal, "nobody") is None


@pytest.mark.parametrize("homes", [3, 40])
def test_the_summary_fits_small_and_large_markets(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], homes: int
) -> None:
    place = tmp_path / "journal.db"
    with Journal.open(place) as journal:
        first = fill(begin(journal, "main-1"), homes, 20)[0]
    print_summary(str(place), "main", "zengrid up --seed 7", since=first.settled_at - 1.0)
    said = capsys.readouterr().out
    assert ("bill h0" in said) == (homes == 3)
    assert f"bills of {homes} homes" in said
    assert "20 slots (0.208 days) settled; run main-1, seed 7." in said
    assert "Fallback used: in " in said
    assert f"zengrid export --run main-1 --journal {place}" in said
    assert "To continue where it ended: zengrid up --seed 7 --resume" in said
    total = sum(float(np.sum(it.bill)) for it in [record(homes, i) for i in range(20)])
    assert f"{total:,.2f} $" in said


def test_a_run_of_earlier_is_not_summed_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "journal.db"
    with Journal.open(place) as journal:
        last = fill(begin(journal, "main-1"), 2, 5)[-1]
    print_summary(str(place), "main", "zengrid up", since=last.settled_at + 1.0)
    assert capsys.readouterr().out == "No slot was settled.\n"


def test_without_a_journal_there_is_nothing_to_say(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(str(tmp_path / "none.db"), "main", "zengrid up", since=0.0)
    assert capsys.readouterr().out == ""
