"""Rows of the live table add up, whatever they stand for."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.sample_status import status
from zengrid_cli.live_view.home_rows import home_rows


@given(sizes=st.lists(st.integers(1, 5), min_size=1, max_size=12), limit=st.integers(0, 70))
def test_rows_add_up(sizes: list[int], limit: int) -> None:
    now = status(sizes)
    assert now.homes is not None
    listed, total = home_rows(now, now.homes, limit)
    assert len(listed) <= limit
    assert total.homes == sum(sizes)
    if sum(row.homes for row in listed) == total.homes:
        for name in ("battery_kw", "pv_kw", "load_kw", "bill", "baseline_bill"):
            assert sum(getattr(row, name) for row in listed) == pytest.approx(getattr(total, name))


def test_stored_energy_counts_by_capacity_and_homes_without_battery_have_none() -> None:
    now = status((4,))
    assert now.homes is not None
    (h0, h1, h2, h3), total = home_rows(now, now.homes, 10)
    assert h3.soc is None
    assert h0.soc is not None
    assert h1.soc is not None
    assert h2.soc is not None
    assert total.soc == pytest.approx((h0.soc + h1.soc + h2.soc) / 3)


def test_a_home_whose_agent_is_unknown_is_away() -> None:
    now = status((1, 1))
    now = now.model_copy(update={"agents": now.agents[:2]})
    assert now.homes is not None
    assert [row.presence for row in home_rows(now, now.homes, 10)[0]] == ["present", "away"]
