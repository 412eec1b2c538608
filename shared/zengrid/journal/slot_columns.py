"""Columns of a slot's row, and how arrays are stored in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zengrid.errors import JournalError

# Columns of the journal, in the order of its rows. Figures come before arrays, so a query for figures alone never reads
# the overflow pages that hold the arrays of many homes.
COUNTS = ("position", "day", "slot", "roster_version", "grid_fallback")
FIGURES = (
    "settled_at", "buy_price", "sell_price", "demand_kw", "export_kw", "consumer_kw", "revenue", "payments", "profit",
    "lost_load_cost", "curtailed_kw", "home_curtailed_kw", "unserved_kw", "home_unserved_kw", "baseline_profit",
)  # fmt: skip
FACILITY_ARRAYS = ("facility_kw", "facility_cost", "baseline_facility_kw")
HOME_ARRAYS = (
    "soc", "battery_kw", "injection_kw", "pv_kw", "load_kw", "bill", "baseline_soc", "baseline_bill",
    "fallback",
)  # fmt: skip
MARKET_COLUMNS = (*COUNTS, *FIGURES, *FACILITY_ARRAYS)
COLUMNS = (*MARKET_COLUMNS, *HOME_ARRAYS)
FLOAT = np.dtype("<f8")
"""Type of every array except fallback, which holds one byte a home."""


def stack(column: str, cells: Sequence[bytes]) -> NDArray[Any]:
    """Combine the arrays of several slots, which must have equal length, into one ``(slot, ...)``."""
    width = len(cells[0])
    if any(len(cell) != width for cell in cells):
        raise JournalError(f"the journal is damaged: {column} changes its length within one roster")
    try:
        if column == "fallback":
            return np.frombuffer(b"".join(cells), np.uint8).reshape(len(cells), width).astype(np.bool_)
        return np.frombuffer(b"".join(cells), FLOAT).reshape(len(cells), width // FLOAT.itemsize)
    except (ValueError, TypeError) as error:
        raise JournalError(f"the journal is damaged: {column} cannot be read ({error})") from error
