"""The sums of a run are the same wherever they are read: while it is written, from its slots, and after pruning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.journal_records import DT_H, begin, record, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RunTotals, SlotRecord
from zengrid.journal.maintenance import prune
from zengrid_cli.report.run_results import add_up_run
from zengrid_gateway.kpis import Kpis, of_run

HOMES = ((0, 3), (1, 4), (2, 1), (0, 3))
"""First home and number of homes in each stretch: h0 leaves and comes back, h4 comes and leaves for good."""
STRETCH = 60
ALL = ("h0", "h1", "h2", "h3", "h4")


def written(journal: Journal) -> tuple[list[SlotRecord], RunTotals]:
    """A run whose homes change, and its sums as its writer adds them up."""
    run, totals, slots = begin(journal, "main-1"), RunTotals(DT_H), []
    for number, (first, count) in enumerate(HOMES):
        homes = roster(count, version=number + 1, first=first)
        for position in range(number * STRETCH, (number + 1) * STRETCH):
            slots.append(record(count, position, version=number + 1))
            run.commit(slots[-1], homes if position == number * STRETCH else None, None if position % 50 else totals)
            totals.add(slots[-1], homes.homes)
    run.close()
    return slots, totals


def by_hand(slots: list[SlotRecord]) -> dict[str, dict[str, float]]:
    """The sums of each home."""
    sums = {home: {"bill": 0.0, "baseline_bill": 0.0, "fallback": 0.0} for home in ALL}
    for slot in slots:
        first, count = HOMES[slot.position // STRETCH]
        for place in range(count):
            for name, column in sums[ALL[first + place]].items():
                sums[ALL[first + place]][name] = column + float(getattr(slot, name)[place])
    return sums


def check(totals: RunTotals, slots: list[SlotRecord]) -> None:
    assert totals.slots == len(slots)
    assert totals.homes == ALL
    homes, market = totals.of_homes(ALL), totals.market()
    for place, (home, sums) in enumerate(by_hand(slots).items()):
        assert {name: column[place] for name, column in homes.items()} == pytest.approx(sums), home
    assert market["profit"] == pytest.approx(sum(slot.profit for slot in slots))
    assert market["bills"] == pytest.approx(homes["bill"].sum())
    assert market["baseline_bills"] == pytest.approx(homes["baseline_bill"].sum())
    assert market["reserve_kwh"] == pytest.approx(DT_H * sum(slot.facility_kw[1:].sum() for slot in slots))
    assert market["curtailed_kwh"] == pytest.approx(
        DT_H * sum(slot.curtailed_kw + slot.home_curtailed_kw for slot in slots)
    )
    assert totals.grid_fallbacks == sum(slot.grid_fallback for slot in slots)


def test_homes_that_leave_keep_their_sums_and_continue_them_when_they_come_back(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        slots, totals = written(journal)
        check(totals, slots)
        check(journal.run().totals(), slots)
    assert totals.of_homes(("h4", "h9", "h0"))["bill"].tolist()[1] == 0.0


def test_sums_count_pruned_days_and_go_on_from_what_is_known(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        slots, _ = written(journal)
        run = journal.run()
        known = run.totals(100)
        assert (known.slots, known.homes) == (100, ALL)
        pruned = prune(journal, run, keep_days=1)
        assert 100 < pruned.kept_from < len(slots)
        again = journal.run()
        check(again.totals(), slots)
        # What is known ends before the slots that are kept: the sums in the journal take its place.
        check(again.totals(known=known), slots)
        recent = again.totals(205)
        check(again.totals(known=recent), slots)
        with pytest.raises(JournalError, match="were pruned"):
            again.totals(100)


def test_gateway_and_summary_report_the_same_sums(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        slots, totals = written(journal)
        prune(journal, journal.run(), keep_days=1)
        run = journal.run()
        summary, kpis = add_up_run(run), of_run(run.name, run.totals())
    assert isinstance(kpis, Kpis)
    assert summary.slots == kpis.slots == len(slots)
    assert list(summary.bills) == list(kpis.prosumers) == list(ALL)
    bills = totals.of_homes(ALL)["bill"]
    np.testing.assert_allclose([kpi.value for kpi in kpis.prosumers.values()], bills)
    np.testing.assert_allclose([pair.real for pair in summary.bills.values()], bills)
    assert summary.profit.real == pytest.approx(kpis.profit.value)
    assert summary.reserve.real == pytest.approx(kpis.reserve_kwh.value)
    assert summary.all_bills.real == pytest.approx(kpis.bills.value) == pytest.approx(bills.sum())
    assert (summary.curtailed_kwh, summary.unserved_kwh) == (kpis.curtailed_kwh, kpis.unserved_kwh)
    assert summary.first_settled_at is None


def test_damaged_sums_are_refused() -> None:
    totals = RunTotals(DT_H)
    totals.add(record(2), ("h0", "h1"))
    good = totals.encode()
    assert RunTotals.decode(good, DT_H).homes == ("h0", "h1")
    for data in (b"", good[:50], good[:-3], good + b"\nh2", b"\xff" * 8 + good[8:], good[:-1] + b"\xff"):
        with pytest.raises(JournalError, match="its totals cannot be read"):
            RunTotals.decode(data, DT_H)
