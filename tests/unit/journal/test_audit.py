"""The audit finds every way in which a journal can be wrong."""

from __future__ import annotations

import numpy as np
import pytest

from support.journal_records import SLOTS_PER_DAY, begin, changed, fill, record, roster
from zengrid.journal import Journal
from zengrid.journal.audit import FINDINGS_MAX, _sequence, audit
from zengrid.journal.block import Block
from zengrid.journal.slot_columns import COLUMNS


def test_a_sound_run_has_no_findings(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=30, count=200)
    assert audit(run) == []


def test_an_empty_run_has_no_findings(journal: Journal) -> None:
    assert audit(begin(journal)) == []


FOUND_IN = {
    "demand_kw": "demand = consumers + imports",
    "export_kw": "exports",
    "consumer_kw": "bills + consumers = revenue - payments",
    "revenue": "revenue",
    "payments": "payments",
    "profit": "profit",
    "lost_load_cost": "profit",
    "curtailed_kw": "facilities + unserved = demand - exports + curtailed",
    "unserved_kw": "facilities + unserved = demand - exports + curtailed",
    "home_curtailed_kw": "curtailed at meters",
    "home_unserved_kw": "unserved at meters",
    "buy_price": "bills",
    "sell_price": "revenue",
    "facility_kw": "facilities + unserved = demand - exports + curtailed",
    "facility_cost": "profit",
    "injection_kw": "bills",
    "battery_kw": "unserved at meters",
    "pv_kw": "unserved at meters",
    "load_kw": "unserved at meters",
    "bill": "bills",
}


@pytest.mark.parametrize("name", FOUND_IN)
def test_a_wrong_value_is_found(file: object, name: str) -> None:
    with Journal.open(str(file)) as journal:
        run = begin(journal)
        fill(run, homes=4, count=3)
        made = record(4, 3)
        run.commit(changed(made, **{name: getattr(made, name) + 1e-6}))
        findings = audit(run)
        assert findings
        assert all(finding.startswith("position 3 (day 0, slot 3): ") for finding in findings)
        assert f": {FOUND_IN[name]}: " in "\n".join(findings)


def test_a_value_that_is_not_finite_is_found(journal: Journal) -> None:
    run = begin(journal)
    fill(run, homes=2, count=1)
    run.commit(changed(record(2, 1), baseline_soc=np.array([0.5, np.nan]), soc=np.array([0.5, 1.5])))
    findings = audit(run)
    assert "position 1 (day 0, slot 1): baseline_soc is not finite" in findings
    assert "position 1 (day 0, slot 1): soc of home h1 is 1.5" in findings


def test_a_day_too_short_is_found() -> None:
    slots = [record(2, 0), record(2, 1), changed(record(2, 2), day=1, slot=0)]
    block = Block(
        roster(2), {name: np.stack(column) for name, column in zip(COLUMNS, zip(*slots, strict=True), strict=True)}
    )
    found = _sequence(block, None, SLOTS_PER_DAY, since=0)
    assert found == ["position 1 (day 0, slot 1) is followed by position 2 (day 1, slot 0)"]


def test_the_number_of_findings_is_bounded(journal: Journal) -> None:
    run = begin(journal)
    for position in range(FINDINGS_MAX + 5):
        run.commit(changed(record(1, position), profit=1e6), roster(1) if position == 0 else None)
    findings = audit(run)
    assert len(findings) == FINDINGS_MAX + 1
    assert findings[-1] == "and more"
