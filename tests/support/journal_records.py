"""Rosters and settled slots to put into a journal: what the core makes of a seeded market."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from support.random_slots import Slot, seeded
from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.journal import Journal, RosterRecord, RunWriter, SlotRecord
from zengrid.journal.slot_columns import COLUMNS, COUNTS, FIGURES

DT_H = 0.25
SLOTS_PER_DAY = 96


def roster(homes: int, version: int = 1, first: int = 0) -> RosterRecord:
    """Homes named by number, each its own agent."""
    names = tuple(f"h{i}" for i in range(first, first + homes))
    specs = tuple({"id": name, "battery": {"capacity_kwh": 6.0}} for name in names)
    return RosterRecord(version, names, specs, (("grid", (), None), *((name, (name,), "a1b2") for name in names)))


def record(homes: int, position: int = 0, version: int = 1, seed: int = 0) -> SlotRecord:
    """One settled slot; what is in it depends on the arguments alone."""
    rng = np.random.default_rng([seed, homes, position])
    slot: Slot = seeded(rng, homes)
    settled = settle(slot.soc, slot.action, slot.exogenous, slot.market)
    command = conventional(slot.exogenous.pv_kw, slot.exogenous.load_kw, slot.market.homes)
    baseline = settle(slot.soc, Action(np.asarray(0.05), command), slot.exogenous, slot.market)
    return SlotRecord.of(
        position=position,
        day=position // SLOTS_PER_DAY,
        slot=position % SLOTS_PER_DAY,
        settled_at=1.7e9 + position,
        buy_price=float(slot.action.buy_price),
        exogenous=slot.exogenous,
        settled=settled,
        baseline=baseline,
        fallback=rng.random(homes) < 0.3,
        grid_fallback=bool(rng.random() < 0.3),
        roster_version=version,
    )


def records(homes: int, count: int, since: int = 0, version: int = 1, seed: int = 0) -> Iterator[SlotRecord]:
    """Consecutive slots."""
    return (record(homes, position, version, seed) for position in range(since, since + count))


def begin(journal: Journal, name: str = "market-1") -> RunWriter:
    """A new run with slots of 15 minutes."""
    return journal.begin(name, "name: paper\n", seed=7, dt_h=DT_H, version="0.1.0")


def fill(run: RunWriter, homes: int, count: int) -> list[SlotRecord]:
    """Commit the first slots of a run, and return them."""
    written = list(records(homes, count))
    for made in written:
        run.commit(made, roster(homes) if made.position == 0 else None)
    return written


def differences(left: SlotRecord, right: SlotRecord) -> list[str]:
    """Columns that are not equal to the last bit (or, for figures, in value)."""
    return [
        name
        for name in COLUMNS
        if (
            getattr(left, name) != getattr(right, name)
            if name in (*COUNTS, *FIGURES)
            else getattr(left, name).tobytes() != getattr(right, name).tobytes()
        )
    ]


def changed(made: SlotRecord, **values: object) -> SlotRecord:
    """The same record, but for some columns."""
    return made._replace(**values)  # type: ignore[arg-type] # tests put in what does not belong there, too
