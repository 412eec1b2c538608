"""What is committed is what is read, to the last bit."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from support.journal_records import begin, changed, differences, record, roster
from zengrid.errors import JournalError
from zengrid.journal import Journal, RosterRecord, SlotRecord
from zengrid.journal.slot_columns import COUNTS, FACILITY_ARRAYS, FIGURES, HOME_ARRAYS

NUMBERS = count()
FLOATS = st.floats(allow_nan=False)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


@pytest.fixture(scope="module")
def shared_journal(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Journal]:
    with Journal.open(tmp_path_factory.mktemp("journal") / "zengrid.db") as opened:
        yield opened


@st.composite
def any_record(draw: st.DrawFn, homes: int) -> SlotRecord:
    facilities = draw(st.integers(0, 4))
    values: dict[str, Any] = {name: draw(st.integers(0, 2**31 - 1)) for name in COUNTS} | {
        name: draw(FLOATS) for name in FIGURES
    }
    values |= {name: draw(arrays(np.float64, facilities)) for name in FACILITY_ARRAYS}
    values |= {name: draw(arrays(np.float64, homes)) for name in HOME_ARRAYS[:-1]}
    values |= {"fallback": draw(arrays(np.bool_, homes)), "grid_fallback": draw(st.booleans())}
    return SlotRecord(**values | {"position": 0, "day": 0, "slot": 0, "roster_version": 1})


@st.composite
def rosters(draw: st.DrawFn) -> RosterRecord:
    homes = tuple(draw(st.lists(st.text(), max_size=5, unique=True)))
    specs = tuple(draw(st.dictionaries(st.text(), JSON, max_size=4)) for _ in homes)
    agents = draw(
        st.lists(st.tuples(st.text(), st.lists(st.sampled_from(homes or ("",))).map(tuple), st.none() | st.text()))
    )
    return RosterRecord(1, homes, specs, tuple(agents))


@given(st.data())
def test_records_and_rosters_come_back(shared_journal: Journal, data: st.DataObject) -> None:
    around = data.draw(rosters())
    made = data.draw(any_record(len(around.homes)))
    run = begin(shared_journal, f"run{next(NUMBERS)}")
    run.commit(made, around)
    run.close()
    seen = shared_journal.run(run.name)
    assert differences(seen.records()[0], made) == []
    assert seen.roster() == around
    (block,) = seen.blocks()
    for name in (*FACILITY_ARRAYS, *HOME_ARRAYS):
        assert block[name][0].tobytes() == getattr(made, name).tobytes()
    for name in FIGURES:
        assert block[name][0] == getattr(made, name)


def test_a_record_of_ten_thousand_homes_is_read_back(journal: Journal) -> None:
    run = begin(journal)
    made = record(10_000)
    run.commit(made, roster(10_000))
    assert differences(run.records()[0], made) == []
    assert run.home("h9999")["bill"].tolist() == [made.bill[9999]]


def test_figures_may_be_of_any_number_type(journal: Journal) -> None:
    run = begin(journal)
    made = record(2)
    run.commit(changed(made, profit=np.asarray(made.profit), day=np.int64(0), grid_fallback=np.True_), roster(2))
    (seen,) = run.records()
    assert (seen.profit, seen.day, seen.grid_fallback) == (made.profit, 0, True)


def test_arrays_may_lie_anyhow_in_memory(journal: Journal) -> None:
    run = begin(journal)
    made = record(3)
    run.commit(changed(made, soc=np.repeat(made.soc, 2)[::2], bill=made.bill.astype(">f8")), roster(3))
    assert differences(run.records()[0], made) == []


def test_arrays_must_fit_the_roster(journal: Journal) -> None:
    run = begin(journal)
    with pytest.raises(JournalError, match=r"soc has shape \(2,\): the roster has 3 homes"):
        run.commit(record(2), roster(3))
    with pytest.raises(JournalError, match=r"fallback has shape \(1, 3\)"):
        run.commit(changed(record(3), fallback=np.zeros((1, 3), bool)), roster(3))
    run.commit(record(3), roster(3))


def test_a_figure_that_is_not_finite_is_refused(file: Path) -> None:
    with Journal.open(file) as journal:
        run = begin(journal)
        with pytest.raises(JournalError, match="profit"):
            run.commit(changed(record(1), profit=float("nan")), roster(1))
        run.commit(record(1), roster(1))
