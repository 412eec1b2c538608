"""Settled slots as tables: for the market or one home, a row a slot, hour or day, as JSON, CSV or Parquet."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic_core import to_json

from zengrid_gateway.archive import Part

Resolution = Literal["slot", "hour", "day"]
Format = Literal["json", "csv", "parquet"]
Table = dict[str, NDArray[Any]]

MEDIA_TYPES: dict[Format, str] = {
    "json": "application/json",
    "csv": "text/csv",
    "parquet": "application/vnd.apache.parquet",
}
_FIRST = ("position", "day", "slot", "hour")
_LAST = ("soc", "baseline_soc", "homes")


def market_table(part: Part, dt_h: float) -> Table:
    """One row a slot: prices, powers, energy, money."""
    facility, conventional = part["facility_kw"], part["baseline_facility_kw"]
    names = ("demand_kw", "export_kw")
    return {
        **_time(part, dt_h),
        **{name: part[name] for name in ("buy_price", "sell_price", *names)},
        "base_kw": facility[:, 0],
        "reserve_kw": facility[:, 1:].sum(axis=1),
        "baseline_base_kw": conventional[:, 0],
        "baseline_reserve_kw": conventional[:, 1:].sum(axis=1),
        "facility_cost": part["facility_cost"].sum(axis=1),
        **{name: part[name] for name in ("curtailed_kwh", "unserved_kwh", "profit", "baseline_profit")},
        "grid_fallback": part["grid_fallback"],
    }


def home_table(part: Part, dt_h: float, home: str) -> Table:
    """One row a slot in which a home took part."""
    if home not in part.homes:
        return {}
    at = part.homes.index(home)
    arrays = ("soc", "battery_kw", "pv_kw", "load_kw", "bill", "baseline_soc", "baseline_bill", "fallback")
    return {
        **_time(part, dt_h),
        **{name: part[name] for name in ("buy_price", "sell_price")},
        "injection_kw": part["injection_kw"][:, at],
        **{name: part[name][:, at] for name in arrays},
    }


def _time(part: Part, dt_h: float) -> Table:
    return {**{name: part[name] for name in ("position", "day", "slot")}, "hour": part["slot"] * dt_h}


def joined(tables: Iterable[Table]) -> Table:
    """Tables with the same columns, one below the other; without any rows, no columns."""
    full = [table for table in tables if table]
    return {name: np.concatenate([table[name] for table in full]) for name in full[0]} if full else {}


def resampled(table: Table, slots: int) -> Table:
    """One row for so many slots: means of powers and prices, sums of energy and money, the last state of charge."""
    if not table or slots == 1:
        return table
    group = table["position"] // slots
    starts = np.flatnonzero(np.diff(group, prepend=group[0] - 1))
    ends = np.append(starts[1:], len(group)) - 1
    counts = ends - starts + 1
    coarse: Table = {}
    for name, column in table.items():
        if name in _FIRST:
            coarse[name] = column[starts]
        elif name in _LAST:
            coarse[name] = column[ends]
        elif name.endswith("fallback"):
            coarse[name] = np.add.reduceat(column.astype(np.int64), starts)
        else:
            sums = np.add.reduceat(column, starts)
            coarse[name] = sums / counts if name.endswith(("_kw", "_price")) else sums
    return coarse


def rows(table: Table) -> list[dict[str, Any]]:
    """Row by row."""
    names = list(table)
    return [dict(zip(names, row, strict=True)) for row in zip(*(table[name].tolist() for name in names), strict=True)]


def as_json(head: dict[str, Any], table: Table) -> bytes:
    """An object with the head's fields, and the rows."""
    return to_json({**head, "rows": rows(table)})


def as_file(table: Table, format: Literal["csv", "parquet"]) -> bytes:
    """A file that spreadsheets or data frames read."""
    import pyarrow as pa

    out = io.BytesIO()
    content = pa.table(table)
    if format == "csv":
        from pyarrow import csv

        csv.write_csv(content, out, csv.WriteOptions(quoting_style="needed"))
    else:
        from pyarrow import parquet

        parquet.write_table(content, out, compression="zstd")
    return out.getvalue()
