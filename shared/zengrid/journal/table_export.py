"""Writes a run as tables for analysis: one row a slot, and one row a home and slot, as CSV or Parquet."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from zengrid.errors import JournalError
from zengrid.journal.block import Block
from zengrid.journal.run_view import RunView

if TYPE_CHECKING:
    import pyarrow as pa

TableFormat = Literal["csv", "parquet"]
SlotProgress = Callable[[int, int], None]
Columns = dict[str, Any]

# Name in the table: column of the journal.
SLOT_COLUMNS = {
    "buy_price_usd_per_kwh": "buy_price",
    "sell_price_usd_per_kwh": "sell_price",
    "demand_kw": "demand_kw",
    "export_kw": "export_kw",
    "consumer_kw": "consumer_kw",
    "curtailed_kw": "curtailed_kw",
    "home_curtailed_kw": "home_curtailed_kw",
    "unserved_kw": "unserved_kw",
    "home_unserved_kw": "home_unserved_kw",
    "revenue_usd": "revenue",
    "payments_usd": "payments",
    "lost_load_cost_usd": "lost_load_cost",
    "profit_usd": "profit",
    "baseline_profit_usd": "baseline_profit",
    "grid_fallback": "grid_fallback",
    "settled_at_unix_s": "settled_at",
}
FACILITY_COLUMNS = {
    "facility_{}_kw": "facility_kw",
    "facility_{}_cost_usd": "facility_cost",
    "baseline_facility_{}_kw": "baseline_facility_kw",
}
HOME_COLUMNS = {
    "soc": "soc",
    "battery_kw": "battery_kw",
    "injection_kw": "injection_kw",
    "pv_kw": "pv_kw",
    "load_kw": "load_kw",
    "bill_usd": "bill",
    "fallback": "fallback",
    "baseline_soc": "baseline_soc",
    "baseline_bill_usd": "baseline_bill",
}


def export(
    run: RunView,
    out: str | Path,
    format: TableFormat = "csv",
    *,
    homes: bool = True,
    days: tuple[int, int | None] = (0, None),
    progress: SlotProgress = lambda done, total: None,
) -> list[Path]:
    """Write ``slots.*``, ``homes.*`` and ``scenario.yaml`` into a directory; floats keep every bit.

    Memory is bounded for runs of any length. A table replaces an older one only when it is complete.

    Parameters
    ----------
    homes:
        Whether to write ``homes.*``, by far the largest file if there are many homes.
    days:
        First day, and the day after the last (None: to the end).
    progress:
        Called with the number of slots written so far, and of all slots.

    Returns
    -------
    list[Path]
        Files written.
    """
    if format not in get_args(TableFormat):
        raise JournalError(f"format = {format!r}: permitted: {', '.join(get_args(TableFormat))}")
    positions = run.days(*days)
    if not positions:
        raise JournalError(f"run {run.name!r}: no slot of day {_span(days)} is settled")
    out = Path(out)
    tables: dict[str, Callable[[RunView, Block], Columns]] = {"slots": slot_table}
    if homes:
        tables["homes"] = home_table
    try:
        out.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            writers = {name: stack.enter_context(_TableFile(out / f"{name}.{format}", format)) for name in tables}
            for block in run.blocks(positions.start, positions.stop, homes=homes):
                for name, table in tables.items():
                    writers[name].write(table(run, block))
                progress(int(block["position"][-1]) + 1 - positions.start, len(positions))
        scenario = out / "scenario.yaml"
        scenario.write_text(run.scenario(), encoding="utf-8")
    except OSError as error:
        raise JournalError(f"export to {out}: {error}") from error
    return [*(out / f"{name}.{format}" for name in tables), scenario]


def slot_table(run: RunView, block: Block) -> Columns:
    """One row a slot."""
    columns = {"run": _repeated(run.name, len(block)), **_time(run, block), "position": block["position"]}
    for name, column in SLOT_COLUMNS.items():
        columns[name] = block[column]
    columns["grid_fallback"] = block["grid_fallback"].astype(np.bool_)
    for name, column in FACILITY_COLUMNS.items():
        columns |= {name.format(i + 1): values for i, values in enumerate(block[column].T)}
    columns["homes"] = np.full(len(block), len(block.roster.homes))
    return columns


def home_table(run: RunView, block: Block) -> Columns:
    """One row a home and slot, slot after slot."""
    count = len(block.roster.homes)
    columns = {"run": _repeated(run.name, len(block) * count)}
    columns |= {name: np.repeat(values, count) for name, values in _time(run, block).items()}
    columns["home"] = _tiled(block.roster.homes, len(block))
    return columns | {name: block[column].ravel() for name, column in HOME_COLUMNS.items()}


class _TableFile:
    """A table file that is written in chunks, and gets its name when it is complete."""

    def __init__(self, path: Path, format: TableFormat) -> None:
        self._path = path
        self._part = path.with_name(f"{path.name}.part")
        self._format = format
        self._writer: Any = None

    def __enter__(self) -> _TableFile:
        return self

    def write(self, columns: Columns) -> None:
        import pyarrow as pa

        chunk = pa.table(columns)
        if self._writer is None:
            self._writer = self._open(chunk.schema)
        self._writer.write_table(chunk)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            if self._writer is not None:
                self._writer.close()
            if kind is None:
                self._part.replace(self._path)
        finally:
            self._part.unlink(missing_ok=True)

    def _open(self, schema: pa.Schema) -> Any:
        if self._format == "csv":
            from pyarrow import csv

            return csv.CSVWriter(str(self._part), schema, write_options=csv.WriteOptions(quoting_style="needed"))
        from pyarrow import parquet

        return parquet.ParquetWriter(str(self._part), schema, compression="zstd")


def _time(run: RunView, block: Block) -> Columns:
    """Start of each slot; ``time_h`` is in hours since midnight."""
    return {"day": block["day"], "slot": block["slot"], "time_h": block["slot"] * run.info.dt_h}


def _repeated(text: str, count: int) -> Any:
    import pyarrow as pa

    return pa.repeat(pa.scalar(text), count)


def _tiled(texts: tuple[str, ...], times: int) -> Any:
    import pyarrow as pa

    return pa.array(texts, pa.string()).take(pa.array(np.tile(np.arange(len(texts)), times)))


def _span(days: tuple[int, int | None]) -> str:
    first, until = days
    return f"{first} or later" if until is None else f"{first} up to {until - 1}"
