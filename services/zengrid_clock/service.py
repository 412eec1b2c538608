"""The clock's loop: one thread takes every event in turn, so that no slot ever sees half a change."""

from __future__ import annotations

import gc
import math
import signal
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid import logs
from zengrid.bus.hub import Event, Hub
from zengrid.core.state import Action, Exogenous
from zengrid.errors import JournalError, JournalUnavailableError
from zengrid.journal import Totals
from zengrid.wire.codec import encode_fields
from zengrid_clock.actions import CommandRange, read_commands, read_price
from zengrid_clock.barrier import Barrier, Moment, Refused
from zengrid_clock.desk import Desk
from zengrid_clock.latency import Latencies
from zengrid_clock.market import LiveMarket
from zengrid_clock.notes import Notes
from zengrid_clock.observations import Observer
from zengrid_clock.pacing import Pace
from zengrid_clock.records import Played, public_slot, slot_record
from zengrid_clock.roster import GRID, Agent, Roster

if TYPE_CHECKING:
    from zengrid.journal import Roster as RosterRecord
    from zengrid.journal import Run, SlotRecord
    from zengrid.scenario import Scenario
    from zengrid_clock.retention import Retention

OFFER_INTERVAL_S = 0.1
"""How often an absent agent is sent an observation, so that a stuck one does not fill its link."""
IDLE_S = 0.5
"""Longest wait for an event, so that signals and late answers are noticed; and how often an absent journal is asked."""
TOTALS_SLOTS = 1000
"""How often what all slots add up to is journalled: a clock that resumes reads at most so many."""
EVENTS_PER_LOOK = 1000
LOOK_S = 0.05
"""Most events handled between two slots, and the time after which the next slot comes first: a flood cannot stop the
market. [s]"""


@dataclass(frozen=True, slots=True)
class ClockSettings:
    """How a clock runs its market."""

    days: int | None = None
    """Length of the run, or None without end."""
    speed: float = 0.0
    """Times faster than real time; 0 as fast as answers come."""
    deadline_s: float = 2.0
    wait_s: float = 15.0
    """How long to wait for the scenario's agents before the first slot."""
    paused: bool = False
    max_homes: int = 100_000
    journal_wait_s: float = 3600.0
    """How long to wait for a journal that cannot take a slot."""


class Clock:
    """Runs the market over a hub and a journal until its last day, a stop request, or a signal."""

    def __init__(
        self, scenario: Scenario, market: LiveMarket, roster: Roster, hub: Hub, run: Run, settings: ClockSettings
    ) -> None:
        self.scenario = scenario
        self.market = market
        self.roster = roster
        self.hub = hub
        self.run = run
        self.settings = settings
        self.pace = Pace(scenario.dt_h * 3600.0, settings.speed, settings.deadline_s)
        self.observer = Observer(hub.keys.run, market)
        self.desk = Desk(self)
        self.notes = Notes(self)
        self.latencies = Latencies()
        self.totals = Totals(scenario.dt_h)
        self.retention: Retention | None = None
        self.refused: Counter[str] = Counter()
        self.journal_waits = 0
        self.journal_away_since: float | None = None
        """While the journal cannot take a slot (monotonic)."""
        self.position = self.day = self.slot = 0
        self.buy_price = min(scenario.buy_prices)
        self.in_slot = self.committing = False
        self.last_record: SlotRecord | None = None
        self._played: Played | None = None
        """The last slot, while it is not in the journal."""
        self._unpublished: SlotRecord | None = None
        """The last slot of the journal, while the world has not been told of it."""

    # ---------------------------------------------------------------- lifecycle

    def serve(self) -> None:
        """Wait for the agents, run the slots, say goodbye."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self.pace.end())
        self.hub.serve_beside(self.hub.keys.history, self.desk.history)
        self.hub.serve_beside(self.hub.keys.scenario, self.desk.told_scenario)
        self.hub.announce()
        self._gather()
        # What was loaded at the start stays: leave it out of garbage collection, and collect the rest rarely.
        gc.collect()
        gc.freeze()
        gc.set_threshold(20_000, 20, 50)
        while self._wait_for_slot():
            self._run_slot()
        self._say_goodbye()

    def _gather(self) -> None:
        """Wait until the scenario's agents are there; start without those that do not come in time."""
        until = time.monotonic() + self.settings.wait_s
        while self.pace.state == "waiting" and not self.roster.everyone_present():
            left = until - time.monotonic()
            if left <= 0:
                break
            self._take(min(left, IDLE_S), None)
        if self.pace.state == "waiting":
            if self.settings.paused:
                self.pace.pause()
            else:
                self.pace.start(time.monotonic())

    def _wait_for_slot(self) -> bool:
        """Handle events until the next slot is due; False when there is none."""
        # One look at what has come in keeps joins and controls alive at full speed.
        until = time.monotonic() + LOOK_S
        for _ in range(EVENTS_PER_LOOK):
            if not self._take(0.0, None) or time.monotonic() > until:
                break
        while True:
            if self.settings.days is not None and self.day >= self.settings.days:
                self.pace.end()
            if self.pace.state == "ended":
                return False
            wait_s = self.pace.wait_s(time.monotonic())
            if wait_s == 0.0:
                self.pace.began(time.monotonic())
                return True
            self._conclude_last()
            self._take(IDLE_S if wait_s is None else min(wait_s, IDLE_S), None)

    def _say_goodbye(self) -> None:
        """Tell everyone that it is over, with the last rewards."""
        self._conclude_last()
        none = np.zeros(len(self.market.homes))
        nothing = Exogenous(none, none, np.zeros(0), np.zeros(()))
        self.observer.look(Moment(self.day, self.slot, "battery"), nothing, self.pace.deadline_s, end=True)
        self.observer.set_price(0.0)
        for agent in self.roster:
            if agent.presence != "away":
                send = self.hub.observe if agent.presence == "present" else self.hub.offer
                send(agent.id, *self.observer.tell(agent))
        if self.settings.days is not None and self.day >= self.settings.days:
            self.run.finish()
        self.notes.note("info", "run is over", slots=self.position)

    # ---------------------------------------------------------------- one slot

    def _run_slot(self) -> None:
        began = time.perf_counter()
        self.in_slot = True
        if self.market.day != self.day:
            self.market.begin_day(self.day)
        exogenous = self.market.profile(self.slot)
        agents = list(self.roster.prosumers.values())

        moment = Moment(self.day, self.slot, "price")
        self.observer.look(moment, exogenous, self.pace.deadline_s)
        barrier = self._open(moment, [self.roster.grid])
        # While the grid agent thinks: make the last slot a fact, and write what prosumers are told, but for the price.
        self._commit_last(barrier)
        moment = Moment(self.day, self.slot, "battery")
        self.observer.look(moment, exogenous, self.pace.deadline_s)
        for agent in agents:
            if barrier.done:
                break
            self.observer.write_ahead(agent)
            self._take(0.0, barrier)
        if not barrier.done:
            self._publish_last()  # else there is more time for it when the prosumers think
        self._collect(barrier)
        self._count_answer(barrier, self.roster.grid)
        self.buy_price = barrier.answers.get(GRID, self.buy_price)
        priced = time.perf_counter()

        self.observer.set_price(self.buy_price)
        barrier = self._open(moment, agents)
        # While they think: tell the world of the last slot, and get ready what this one needs.
        self._publish_last()
        baseline = self.market.baseline(self.slot)
        command = self.market.fallback(self.slot)
        prepared = self.market.prepare(exogenous)
        self._collect(barrier)
        for agent in agents:
            self._count_answer(barrier, agent)
            if agent.id in barrier.answers:
                command[self.market.agents[agent.id]] = barrier.answers[agent.id]
        answered = time.perf_counter()

        settled = self.market.settle(prepared, Action(np.asarray(self.buy_price), command))
        self.market.advance(settled, baseline)
        self.observer.settled(self.day, self.slot, self.buy_price)
        for agent in self.roster:
            agent.settled = True
        times_s = priced - began, answered - priced, time.perf_counter() - answered
        self._played = Played(settled, baseline, exogenous, self.day, self.slot, times_s)
        self._advance()

    def _advance(self) -> None:
        self.slot += 1
        if self.slot == self.scenario.slots_per_day:
            self.day, self.slot = self.day + 1, 0
        self.pace.finished()
        self.in_slot = False
        if self.desk.waiting:
            self._conclude_last()

    def _conclude_last(self) -> None:
        """Put the last slot into the journal, and tell the world of it, where that is still to be done."""
        self._commit_last(None)
        self._publish_last()
        self.desk.apply_changes()

    def _commit_last(self, barrier: Barrier[Any] | None) -> None:
        """Put the last slot into the journal.

        Nobody but the grid agent has heard of it before, and what that answers is used only after it.

        Parameters
        ----------
        barrier:
            The phase that is open meanwhile: where the journal lets the clock wait, its answers count.
        """
        played, self._played = self._played, None
        if played is None:
            return
        began = time.perf_counter()
        roster = self.desk.changed_roster()
        record = slot_record(self, played)
        self.committing = True
        self._commit(record, roster, barrier)
        self.committing = False
        # From here on the slot is a fact: it is in the journal.
        committed = time.perf_counter()
        self.position += 1
        self.last_record = self._unpublished = record
        self.totals.add(record, self.market.homes)
        self.notes.slot_settled()
        if self.slot == 0 and self.retention is not None:
            self.retention.day_is_over()
        price_s, battery_s, settle_s = played.times_s
        self.latencies.add(price_s, battery_s, settle_s + committed - began, committed)

    def _publish_last(self) -> None:
        """Tell the world of the last slot, where that is still to be done."""
        record, self._unpublished = self._unpublished, None
        if record is not None:
            self.hub.publish_slot(encode_fields(public_slot(self, record)))

    def _commit(self, record: SlotRecord, roster: RosterRecord | None, barrier: Barrier[Any] | None) -> None:
        """Put a slot into the journal; where that cannot take it, wait until it can, for too long, or asked to end."""
        totals = self.totals if self.position % TOTALS_SLOTS == 0 else None
        said = ""
        while True:
            try:
                self.run.commit(record, roster, totals)
                break
            except JournalUnavailableError as error:
                self._wait_for_journal(error)
                if str(error) != said:
                    said = str(error)
                    logs.say(f"waiting: {said}", "warning", day=record.day, slot=record.slot)
            until = time.monotonic() + IDLE_S
            while (left := until - time.monotonic()) > 0:
                self._take(left, barrier)
        if self.journal_away_since is not None:
            away_s = time.monotonic() - self.journal_away_since
            self.journal_away_since = None
            text = f"going on: slot {record.slot} of day {record.day} is settled, after {away_s:.1f} s"
            logs.say(text, "warning", day=record.day, slot=record.slot)

    def _wait_for_journal(self, error: JournalUnavailableError) -> None:
        """Count the wait, and end it where nobody wants to wait any longer."""
        now = time.monotonic()
        if self.journal_away_since is None:
            self.journal_away_since = now
            self.journal_waits += 1
        if self.pace.state == "ended":
            raise error
        if now - self.journal_away_since >= self.settings.journal_wait_s:
            raise JournalError(f"given up after {self.settings.journal_wait_s:g} s: {error}")

    # ---------------------------------------------------------------- one phase

    def _open(self, moment: Moment, agents: list[Agent]) -> Barrier[Any]:
        """Send everyone its observation and start waiting."""
        present, absent = [], []
        for agent in agents:
            presence = agent.presence
            if presence == "present":
                present.append(agent)
                self.hub.observe(agent.id, *self.observer.tell(agent))
            elif presence == "absent":
                absent.append(agent)
                now = time.monotonic()
                if agent.offered is None or now >= agent.offered[1] + OFFER_INTERVAL_S:
                    agent.offered = moment, now
                    self.hub.offer(agent.id, *self.observer.tell(agent))
        waited = [agent.id for agent in present]
        return Barrier(moment, waited + [agent.id for agent in absent], waited)

    def _collect(self, barrier: Barrier[Any]) -> None:
        """Take events until nobody is waited for, or the deadline has passed."""
        deadline = time.monotonic() + self.pace.deadline_s
        while not barrier.done:
            left = deadline - time.monotonic()
            if left <= 0:
                return
            self._take(min(left, IDLE_S), barrier)

    def _count_answer(self, barrier: Barrier[Any], agent: Agent) -> None:
        """Write down how an agent fared in this phase."""
        if agent.id in barrier.answers:
            agent.counted()
        elif agent.id in barrier.waiting:
            agent.missed("deadline")
        elif agent.id in barrier.waited:
            agent.missed("gone")
        else:
            agent.missed("absent" if agent.presence == "absent" else "away")

    # ---------------------------------------------------------------- events

    def _take(self, timeout_s: float, barrier: Barrier[Any] | None) -> bool:
        """Handle one event, if one comes within the time."""
        self.desk.answer_overdue()
        event = self.hub.receive(timeout_s)
        if event is None:
            return False
        if event.query is not None and not self.in_slot and not self.committing:
            # Between two slots an answer may change who takes part, and tells of the last slot: that must be a fact.
            self._conclude_last()
        with self.guarded(event):
            self._handle(event, barrier)
        return True

    @contextmanager
    def guarded(self, event: Event | None = None) -> Iterator[None]:
        """Survive whatever goes wrong with one event: count it as ``internal``, log it with its cause, and drop it."""
        try:
            yield
        except JournalError:
            raise  # what the market itself cannot do without
        except Exception as error:  # noqa: BLE001 - nothing that a stranger sends may end the market
            self.refused["internal"] += 1
            what = {} if event is None else {"kind": event.kind, "agent": event.agent}
            logs.say("".join(traceback.format_exception(error)), "error", **what)
            if event is not None and event.query is not None and not event.query.is_closed:
                self.desk.fail(event, error)

    def _handle(self, event: Event, barrier: Barrier[Any] | None) -> None:
        if event.kind == "action":
            self._take_action(event, barrier)
        elif event.kind in ("alive", "gone"):
            self._take_presence(event, barrier)
        elif event.kind == "second_session":
            self.refused["second_session"] += 1
            self.notes.note("info", "second session refused", agent=event.agent)
        else:
            self.desk.answer(event)

    def _take_action(self, event: Event, barrier: Barrier[Any] | None) -> None:
        agent = self.roster.get(event.agent)
        if agent is None:
            self.refused["unknown_agent"] += 1
            return
        # Between two slots nothing is awaited: whatever comes is late (or never was in time).
        judge = barrier if barrier is not None else Barrier(Moment(self.day, self.slot, "price"), (), ())
        try:
            judge.offer(agent.id, lambda: self._read(agent, event, judge.moment))
        except Refused as refusal:
            self.refused[refusal.cause] += 1
            self.notes.note("debug", "action refused", agent=agent.id, cause=refusal.cause)
            self._welcome_back(agent, refusal)

    def _read(self, agent: Agent, event: Event, moment: Moment) -> tuple[Moment, Any]:
        run = self.hub.keys.run
        if agent.role == "grid":
            return read_price(agent, event.payload, event.encoding, run, moment, self.scenario.buy_prices)
        if agent.permitted is None:
            agent.permitted = CommandRange(self.market.market.homes, self.market.agents[agent.id])
        return read_commands(agent, event.payload, event.encoding, run, moment, agent.permitted)

    def _welcome_back(self, agent: Agent, refusal: Refused) -> None:
        """An absent agent that answered its last observation within the deadline is waited for again."""
        if agent.presence != "absent" or agent.offered is None:
            return
        moment, since = agent.offered
        if moment == refusal.moment and time.monotonic() - since <= self.pace.deadline_s:
            agent.misses = 0

    def _take_presence(self, event: Event, barrier: Barrier[Any] | None) -> None:
        agent = self.roster.get(event.agent)
        if agent is None:
            return
        agent.token = event.kind == "alive"
        if agent.token:
            agent.bound = -math.inf
        elif barrier is not None:
            barrier.give_up(agent.id)
