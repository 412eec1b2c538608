"""Coarser tables add up to the finer ones, and every format says the same."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
from hypothesis import given
from hypothesis import strategies as st

from zengrid_gateway.archive import Part
from zengrid_gateway.tables import Table, as_file, home_table, joined, market_table, resampled, rows


def part(since: int, slots: int, homes: tuple[str, ...], seed: int = 0, slots_per_day: int = 24) -> Part:
    rng = np.random.default_rng([seed, since])
    position = np.arange(since, since + slots)
    columns: dict[str, Any] = {"position": position, "day": position // slots_per_day, "slot": position % slots_per_day}
    figures = ("buy_price", "sell_price", "demand_kw", "export_kw", "curtailed_kwh", "unserved_kwh", "profit")
    columns |= {name: rng.random(slots) for name in (*figures, "baseline_profit")}
    columns |= {name: rng.random((slots, 3)) for name in ("facility_kw", "facility_cost", "baseline_facility_kw")}
    columns["grid_fallback"] = rng.random(slots) < 0.5
    arrays = ("soc", "battery_kw", "injection_kw", "pv_kw", "load_kw", "bill", "baseline_soc")
    columns |= {name: rng.random((slots, len(homes))) for name in (*arrays, "baseline_bill")}
    columns["fallback"] = rng.random((slots, len(homes))) < 0.5
    return Part(homes, columns)


@given(st.integers(0, 50), st.integers(1, 120), st.sampled_from([1, 2, 4, 24]))
def test_resampling_adds_up(since: int, slots: int, group: int) -> None:
    table = market_table(part(since, slots, ("a",)), 1.0)
    coarse = resampled(table, group)
    assert np.isclose(coarse["profit"].sum(), table["profit"].sum())
    assert coarse["grid_fallback"].sum() == table["grid_fallback"].sum()
    assert coarse["position"][0] == since
    assert (np.diff(coarse["position"] // group) == 1).all()
    counts = np.diff(np.append(coarse["position"], since + slots))
    assert np.isclose((coarse["demand_kw"] * counts).sum(), table["demand_kw"].sum())


def test_reserve_is_all_but_the_first_facility() -> None:
    of = part(0, 5, ("a",))
    table = market_table(of, 1.0)
    assert np.array_equal(table["base_kw"], of["facility_kw"][:, 0])
    assert np.allclose(table["reserve_kw"], of["facility_kw"][:, 1] + of["facility_kw"][:, 2])


def test_a_home_that_comes_and_goes() -> None:
    parts = [part(0, 3, ("a", "b")), part(3, 4, ("a",)), part(7, 2, ("a", "c", "b"))]
    table = joined(home_table(each, 0.5, "b") for each in parts)
    assert table["position"].tolist() == [0, 1, 2, 7, 8]
    assert table["hour"].tolist() == [0.0, 0.5, 1.0, 3.5, 4.0]
    assert table["bill"].tolist() == [*parts[0]["bill"][:, 1], *parts[2]["bill"][:, 2]]
    assert resampled(table, 24)["soc"].tolist() == [table["soc"][-1]]


def test_a_table_is_written_as_csv_and_parquet() -> None:
    table = market_table(part(0, 4, ("a",)), 1.0)
    csv = pyarrow.csv.read_csv(io.BytesIO(as_file(table, "csv")))
    parquet = pyarrow.parquet.read_table(io.BytesIO(as_file(table, "parquet")))
    assert parquet.to_pylist() == rows(table)
    assert csv.column_names == list(table)
    assert csv.to_pylist() == rows(table)


def test_an_empty_table_is_an_empty_file() -> None:
    empty: Table = joined([])
    assert rows(resampled(empty, 24)) == []
    assert pyarrow.parquet.read_table(io.BytesIO(as_file(empty, "parquet"))).num_rows == 0
    assert as_file(empty, "csv").strip() == b""
