"""A slot is in the journal before anyone hears of it, with the price, roster and fallbacks of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from support.journal_records import roster
from support.random_slots import seeded
from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action
from zengrid.journal import Journal, RosterRecord, RunTotals, RunWriter, SlotRecord
from zengrid.journal.slot_record import BaselineSlot
from zengrid_clock.journal_writer import JournalWriter
from zengrid_clock.latencies import Latencies
from zengrid_clock.run_state import RunState
from zengrid_clock.slot_pipeline import SlotPipeline
from zengrid_clock.slot_records import PlayedSlot, public_slot, settled_slot

HOMES, DT_H, SLOTS_PER_DAY = 3, 0.25, 96


def played(state: RunState, of: RosterRecord, fallback: list[bool]) -> PlayedSlot:
    slot = seeded(np.random.default_rng(state.slot), HOMES)
    command = conventional(slot.exogenous.pv_kw, slot.exogenous.load_kw, slot.market.homes)
    baseline = settle(slot.soc, Action(np.asarray(0.05), command), slot.exogenous, slot.market)
    return PlayedSlot(
        day=state.day,
        slot=state.slot,
        buy_price=float(slot.action.buy_price),
        exogenous=slot.exogenous,
        settlement=settle(slot.soc, slot.action, slot.exogenous, slot.market),
        baseline=BaselineSlot(baseline.soc, baseline.bill, baseline.profit, baseline.facility_kw),
        fallback=np.array(fallback),
        grid_fallback=False,
        roster=of,
        durations_s=(0.001, 0.002, 0.003),
    )


class Market:
    """A pipeline over a real journal, which notes what it publishes."""

    def __init__(self, run: RunWriter) -> None:
        self.run = run
        self.state = RunState(SLOTS_PER_DAY, 0.05, RunTotals(DT_H))
        self.journalled: list[int] = []
        self.published: list[tuple[SlotRecord, RosterRecord]] = []
        writer = JournalWriter(run, 1.0, lambda: False)
        self.pipeline = SlotPipeline(
            self.state,
            writer,
            Latencies(),
            lambda record, of: self.published.append((record, of)),
            lambda record: self.journalled.append(record.position),
        )

    def commit(self) -> None:
        self.pipeline.commit(lambda timeout_s: None)


def test_a_slot_is_published_only_after_its_commit(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        market = Market(journal.begin("market-1", "name: paper\n", seed=0, dt_h=DT_H, version="0"))
        state, pipeline = market.state, market.pipeline
        pipeline.add(played(state, roster(HOMES), [False] * HOMES))
        state.slot_played()
        pipeline.publish()
        assert market.published == []
        assert market.run.count() == 0
        market.commit()
        assert market.run.count() == state.position == 1
        assert market.journalled == [0]
        assert market.published == []
        pipeline.publish()
        pipeline.publish()
        assert [record.position for record, _ in market.published] == [0]


def test_a_record_keeps_its_own_price_roster_and_fallbacks(tmp_path: Path) -> None:
    """Whatever has changed by the time at which it is written."""
    with Journal.open(tmp_path / "journal.db") as journal:
        market = Market(journal.begin("market-1", "name: paper\n", seed=0, dt_h=DT_H, version="0"))
        state, pipeline = market.state, market.pipeline
        first, second = roster(HOMES, version=1), roster(HOMES, version=2, first=5)
        slots = [played(state, first, [True, False, False])]
        pipeline.add(slots[0])
        state.slot_played()
        state.buy_price = 99.0
        market.commit()
        slots.append(played(state, second, [False, False, True]))
        pipeline.add(slots[1])
        state.slot_played()
        market.commit()
        records = market.run.records()
        assert [record.buy_price for record in records] == [slot.buy_price for slot in slots]
        assert [record.fallback.tolist() for record in records] == [[True, False, False], [False, False, True]]
        assert [record.roster_version for record in records] == [1, 2]
        assert [(state.day, state.slot), state.position, state.totals.slots] == [(0, 2), 2, 2]


def test_the_public_and_operators_are_given_the_same_slot(tmp_path: Path) -> None:
    with Journal.open(tmp_path / "journal.db") as journal:
        market = Market(journal.begin("market-1", "name: paper\n", seed=0, dt_h=DT_H, version="0"))
        market.pipeline.add(played(market.state, roster(HOMES), [True, False, False]))
        market.commit()
        market.pipeline.publish()
        ((record, of),) = market.published
        public = public_slot(record, of, "main", DT_H, "running")
        settled = settled_slot(record, of, "main", DT_H, homes=True)
        assert public["acted"] == ("grid", "h1", "h2")
        assert public["fallback"] == ("h0",)
        for name, value in public.items():
            assert np.array_equal(getattr(settled, name), value), name
        assert settled.detail is not None
        assert settled.detail.fallback == ("h0",)
