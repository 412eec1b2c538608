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
from numpy.typing import NDArray

from zengrid import logs
from zengrid.bus.clock_link import BusEvent, ClockLink
from zengrid.core.state import Action, Exogenous
from zengrid.errors import JournalError
from zengrid.journal import RunTotals
from zengrid.scenario import dumps
from zengrid.wire.codec import encode, encode_fields
from zengrid_clock.actions import CommandRange, read_commands, read_price
from zengrid_clock.admission import Admission, AdmissionLimits, JoinReplies
from zengrid_clock.agent_registry import GRID, AgentRegistry, MarketAgent
from zengrid_clock.barrier import ActionRefused, PhaseBarrier, SlotPhase
from zengrid_clock.between_slots import BetweenSlots
from zengrid_clock.event_log import EventLog
from zengrid_clock.journal_writer import JournalWriter
from zengrid_clock.latencies import Latencies
from zengrid_clock.live_market import LiveMarket
from zengrid_clock.observations import ObservationWriter
from zengrid_clock.operator_commands import OperatorCommands
from zengrid_clock.pace import Pace
from zengrid_clock.read_only_requests import history_reply, scenario_reply
from zengrid_clock.requests import RequestHandler
from zengrid_clock.resume import restore
from zengrid_clock.run_state import RunState
from zengrid_clock.slot_pipeline import SlotPipeline
from zengrid_clock.slot_records import PlayedSlot, RosterVersions, public_slot, settled_slot
from zengrid_clock.status import StatusReport, homes_status

if TYPE_CHECKING:
    from zengrid.journal import RosterRecord, RunWriter, SlotRecord
    from zengrid.scenario import Days, Scenario
    from zengrid.wire.queries import JoinReply
    from zengrid.wire.slots import SettledSlot
    from zengrid_clock.retention import Retention

Floats = NDArray[np.float64]

OFFER_INTERVAL_S = 0.1
"""How often an absent agent gets an observation: a stuck one must not fill its link. [s]"""
IDLE_S = 0.5
"""Longest wait for an event, so that signals and overdue answers are noticed. [s]"""
EVENTS_PER_LOOK = 1000
LOOK_S = 0.05
"""Between two slots the clock handles at most so many events, and no new one after this time: a flood cannot stop the
market. [s]"""


@dataclass(frozen=True, slots=True)
class ClockSettings:
    """How a clock runs its market."""

    days: int | None = None
    """Length of the run, or None without end."""
    speed: float = 0.0
    """Times real time; 0 is as fast as answers come."""
    deadline_s: float = 2.0
    wait_s: float = 15.0
    """How long to wait for the scenario's agents before the first slot."""
    paused: bool = False
    max_homes: int = 100_000
    journal_wait_s: float = 3600.0
    """How long to wait for a journal that cannot take a slot."""


class Clock:
    """Runs the market over a hub and a journal until its last day, a stop request, or a signal."""

    def __init__(self, scenario: Scenario, days: Days, hub: ClockLink, run: RunWriter, settings: ClockSettings) -> None:
        self.scenario = scenario
        self.settings = settings
        self.run = run
        self.hub = hub
        self.market = LiveMarket(scenario, days)
        self.registry = AgentRegistry(agent.id for agent in scenario.agents)
        self.state = RunState(scenario.slots_per_day, min(scenario.buy_prices), RunTotals(scenario.dt_h))
        self.pace = Pace(scenario.dt_h * 3600.0, settings.speed, settings.deadline_s)
        self.observations = ObservationWriter(hub.keys.run, self.market)
        self.event_log = EventLog(self.state)
        self.retention: Retention | None = None
        self.rosters = RosterVersions()
        self.refused: Counter[str] = Counter()
        """Refused messages by cause."""
        self._between_slots = BetweenSlots()
        self._latencies = Latencies()
        self._journal = JournalWriter(run, settings.journal_wait_s, lambda: self.pace.state == "ended")
        self._pipeline = SlotPipeline(self.state, self._journal, self._latencies, self._publish, self._slot_journalled)
        self._commands = OperatorCommands(self.pace, self._between_slots, self._encode_status)
        limits = AdmissionLimits(settings.max_homes, hub.agents)
        self._admission = Admission(
            self.market, self.registry, self.rosters, self._between_slots, limits, self.event_log, hub.release_agent
        )
        self._join_replies = JoinReplies(hub.keys.run, scenario, settings.deadline_s)
        self._requests = RequestHandler(
            self._admission, self._commands, self._join_reply, self.state.next_to_begin,
            lambda: self.pace.state == "ended", self.refused, self.event_log,
        )  # fmt: skip
        self._status = StatusReport(
            hub.keys.run, scenario, settings.days, self.state, self.pace, self.registry, self._latencies,
            self._journal, (self.refused, hub.overflowed), self._last_slot,
            lambda: homes_status(self.market, self.state.totals, self.state.slot), lambda: self.market.agents,
        )  # fmt: skip

    # ---------------------------------------------------------------- lifecycle

    def resume(self) -> None:
        """Continue the run where its journal ends; call it before ``serve``."""
        version = restore(self.run, self.scenario, self.state, self.registry, self.market)
        self.rosters.continue_after(version)
        last = self.state.last_record
        if last is not None:
            self.observations.slot_settled(last.day, last.slot, last.buy_price)
        self.event_log.log("info", "run is resumed", journal=self.run.name)

    def serve(self) -> None:
        """Wait for the agents, play the slots, tell everyone that the market is over."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self.pace.end())
        name = self.hub.keys.run
        self.hub.serve_in_thread(self.hub.keys.history, lambda payload: history_reply(payload, self.run, name))
        self.hub.serve_in_thread(
            self.hub.keys.scenario, lambda payload: scenario_reply(payload, dumps(self.scenario), name)
        )
        self.hub.announce()
        self._wait_for_agents()
        _collect_garbage_rarely()
        while self._wait_for_slot():
            self._play_slot()
        self._end()

    def _wait_for_agents(self) -> None:
        """Wait until the scenario's agents are present, but not for longer than the settings say."""
        until = time.monotonic() + self.settings.wait_s
        while self.pace.state == "waiting" and not self.registry.everyone_present():
            left_s = until - time.monotonic()
            if left_s <= 0:
                break
            self._take_event(min(left_s, IDLE_S), None)
        if self.pace.state == "waiting":
            if self.settings.paused:
                self.pace.pause()
            else:
                self.pace.start(time.monotonic())

    def _wait_for_slot(self) -> bool:
        """Handle events until the next slot is due; return False if there is none."""
        # One look at the events that have arrived keeps joins and commands working at full speed.
        until = time.monotonic() + LOOK_S
        for _ in range(EVENTS_PER_LOOK):
            if not self._take_event(0.0, None) or time.monotonic() > until:
                break
        while True:
            if self.settings.days is not None and self.state.day >= self.settings.days:
                self.pace.end()
            if self.pace.state == "ended":
                return False
            wait_s = self.pace.wait_s(time.monotonic())
            if wait_s == 0.0:
                self.pace.began(time.monotonic())
                return True
            self._conclude_slot()
            self._take_event(IDLE_S if wait_s is None else min(wait_s, IDLE_S), None)

    def _end(self) -> None:
        """Tell every agent that the market is over, with its last reward."""
        self._conclude_slot()
        zeros = np.zeros(len(self.market.homes))
        phase = SlotPhase(self.state.day, self.state.slot, "battery")
        nothing = Exogenous(zeros, zeros, np.zeros(0), np.zeros(()))
        self.observations.begin_phase(phase, nothing, self.pace.deadline_s, end=True)
        self.observations.set_price(0.0)
        for agent in self.registry:
            if agent.presence != "away":
                send = self.hub.observe if agent.presence == "present" else self.hub.offer
                send(agent.id, *self.observations.encode(agent))
        if self.settings.days is not None and self.state.day >= self.settings.days:
            self.run.finish()
        self.event_log.log("info", "run is over", slots=self.state.position)

    # ---------------------------------------------------------------- one slot

    def _play_slot(self) -> None:
        """Play one slot: the grid's price, the homes' commands, the settlement."""
        market, state = self.market, self.state
        began = time.perf_counter()
        state.is_playing = True
        self._between_slots.close()
        if market.day != state.day:
            market.begin_day(state.day)
        exogenous = market.profile(state.slot)

        self._play_price_phase(exogenous)
        priced = time.perf_counter()

        barrier = self._open_battery_phase()
        # While the prosumers decide: publish the last slot, and prepare the settlement of this one.
        self._pipeline.publish()
        baseline = market.baseline(state.slot)
        command_kw = market.fallback(state.slot)
        prepared = market.prepare(exogenous)
        fallback = self._close_battery_phase(barrier, command_kw)
        answered = time.perf_counter()

        settlement = market.settle(prepared, Action(np.asarray(state.buy_price), command_kw))
        market.advance(settlement, baseline)
        self.observations.slot_settled(state.day, state.slot, state.buy_price)
        for agent in self.registry:
            agent.played_last_slot = True
        durations_s = priced - began, answered - priced, time.perf_counter() - answered
        self._pipeline.add(
            PlayedSlot(
                state.day, state.slot, state.buy_price, exogenous, settlement, baseline, fallback,
                not self.registry.grid.acted_last, self._roster(), durations_s,
            )
        )  # fmt: skip
        state.slot_played()
        self.pace.finished()
        if self._between_slots.has_changes:
            self._conclude_slot()

    def _play_price_phase(self, exogenous: Exogenous) -> None:
        """Ask the grid agent for the price; meanwhile journal the last slot and prepare what prosumers see."""
        state, grid = self.state, self.registry.grid
        phase = SlotPhase(state.day, state.slot, "price")
        self.observations.begin_phase(phase, exogenous, self.pace.deadline_s)
        barrier = self._open_phase(phase, [grid])
        self._pipeline.commit(lambda timeout_s: self._take_event(timeout_s, barrier))
        phase = SlotPhase(state.day, state.slot, "battery")
        self.observations.begin_phase(phase, exogenous, self.pace.deadline_s)
        for agent in self.registry.prosumers.values():
            if barrier.is_complete:
                break
            self.observations.encode_ahead(agent)
            self._take_event(0.0, barrier)
        if not barrier.is_complete:
            self._pipeline.publish()  # otherwise there is more time for it while the prosumers decide
        self._await_actions(barrier)
        self._count_outcome(barrier, grid)
        state.buy_price = barrier.actions.get(GRID, state.buy_price)

    def _open_battery_phase(self) -> PhaseBarrier[Any]:
        """Send every prosumer its observation."""
        self.observations.set_price(self.state.buy_price)
        phase = SlotPhase(self.state.day, self.state.slot, "battery")
        return self._open_phase(phase, list(self.registry.prosumers.values()))

    def _close_battery_phase(self, barrier: PhaseBarrier[Any], command_kw: Floats) -> NDArray[np.bool_]:
        """Wait for the prosumers, and write their commands over those of the fallback rule.

        Returns
        -------
        ``(home,)`` whether the fallback rule acts for it.
        """
        self._await_actions(barrier)
        fallback = np.ones(len(command_kw), dtype=np.bool_)
        for agent in self.registry.prosumers.values():
            self._count_outcome(barrier, agent)
            if agent.id in barrier.actions:
                own = self.market.agents[agent.id]
                command_kw[own] = barrier.actions[agent.id]
                fallback[own] = False
        return fallback

    def _conclude_slot(self) -> None:
        """Journal and publish the last slot, then apply the changes that waited for its end."""
        self._pipeline.commit(lambda timeout_s: self._take_event(timeout_s, None))
        self._pipeline.publish()
        for change in self._between_slots.open():
            with self._guarded():
                change()
        self._commands.answer_all()

    def _slot_journalled(self, record: SlotRecord) -> None:
        self.event_log.slot_journalled(self.registry)
        if record.slot == self.scenario.slots_per_day - 1 and self.retention is not None:
            self.retention.day_is_over()

    def _publish(self, record: SlotRecord, roster: RosterRecord) -> None:
        state = "running" if self.pace.state == "waiting" else self.pace.state
        self.hub.publish_slot(encode_fields(public_slot(record, roster, self.hub.keys.run, self.scenario.dt_h, state)))

    # ---------------------------------------------------------------- one phase

    def _open_phase(self, phase: SlotPhase, agents: list[MarketAgent]) -> PhaseBarrier[Any]:
        """Send the agents their observations; absent ones get theirs only now and then."""
        present, absent = [], []
        for agent in agents:
            presence = agent.presence
            if presence == "present":
                present.append(agent.id)
                self.hub.observe(agent.id, *self.observations.encode(agent))
            elif presence == "absent":
                absent.append(agent.id)
                now = time.monotonic()
                if agent.offered is None or now >= agent.offered[1] + OFFER_INTERVAL_S:
                    agent.offered = phase, now
                    self.hub.offer(agent.id, *self.observations.encode(agent))
        return PhaseBarrier(phase, present + absent, present)

    def _await_actions(self, barrier: PhaseBarrier[Any]) -> None:
        """Take events until no action is missing, or the deadline has passed."""
        deadline = time.monotonic() + self.pace.deadline_s
        while not barrier.is_complete:
            left_s = deadline - time.monotonic()
            if left_s <= 0:
                return
            self._take_event(min(left_s, IDLE_S), barrier)

    def _count_outcome(self, barrier: PhaseBarrier[Any], agent: MarketAgent) -> None:
        """Count whether an agent acted in this phase, or why the fallback rule acts for it."""
        if agent.id in barrier.actions:
            agent.count_action()
        elif agent.id in barrier.missing:
            agent.count_fallback("deadline")
        elif agent.id in barrier.awaited:
            agent.count_fallback("gone")
        else:
            agent.count_fallback("absent" if agent.presence == "absent" else "away")

    # ---------------------------------------------------------------- events

    def _take_event(self, timeout_s: float, barrier: PhaseBarrier[Any] | None) -> bool:
        """Handle one event, if one arrives within the time.

        Parameters
        ----------
        barrier:
            The open phase, whose actions count.
        """
        self._commands.answer_overdue()
        event = self.hub.receive(timeout_s)
        if event is None:
            return False
        if event.query is not None and not self.state.is_playing and not self._pipeline.is_committing:
            # Between two slots a request may change the market, and its answer tells of the last slot.
            self._conclude_slot()
        with self._guarded(event):
            self._handle(event, barrier)
        return True

    @contextmanager
    def _guarded(self, event: BusEvent | None = None) -> Iterator[None]:
        """Survive any failure to handle an event: count it as ``internal``, log its cause, and drop the event."""
        try:
            yield
        except JournalError:
            raise  # the market cannot continue without its journal
        except Exception as error:  # noqa: BLE001 - nothing that a stranger sends may end the market
            self.refused["internal"] += 1
            source = {} if event is None else {"kind": event.kind, "agent": event.agent}
            logs.print_message("".join(traceback.format_exception(error)), "error", **source)
            if event is not None:
                self._requests.refuse_failed(event, error)

    def _handle(self, event: BusEvent, barrier: PhaseBarrier[Any] | None) -> None:
        if event.kind == "action":
            self._handle_action(event, barrier)
        elif event.kind in ("alive", "gone"):
            self._handle_presence(event, barrier)
        elif event.kind == "second_session":
            self.refused["second_session"] += 1
            self.event_log.log("info", "second session refused", agent=event.agent)
        else:
            self._requests.answer(event)

    def _handle_action(self, event: BusEvent, barrier: PhaseBarrier[Any] | None) -> None:
        agent = self.registry.get(event.agent)
        if agent is None:
            self.refused["unknown_agent"] += 1
            return
        if barrier is None:
            # Between two slots no action is expected: any that arrives is late, or was never in time.
            barrier = PhaseBarrier(SlotPhase(self.state.day, self.state.slot, "price"), (), ())
        try:
            barrier.offer(agent.id, lambda: self._read_action(agent, event, barrier.phase))
        except ActionRefused as refusal:
            self.refused[refusal.cause] += 1
            self.event_log.log("debug", "action refused", agent=agent.id, cause=refusal.cause)
            self._notice_return(agent, refusal)

    def _read_action(self, agent: MarketAgent, event: BusEvent, phase: SlotPhase) -> tuple[SlotPhase, Any]:
        sender = event.payload, event.encoding, self.hub.keys.run, agent.instance
        if agent.role == "grid":
            return read_price(*sender, phase, self.scenario.buy_prices)
        if agent.permitted is None:
            agent.permitted = CommandRange(self.market.params.homes, self.market.agents[agent.id])
        return read_commands(*sender, phase, agent.permitted)

    def _notice_return(self, agent: MarketAgent, refusal: ActionRefused) -> None:
        """Wait again for an absent agent that answered its last observation within the deadline."""
        if agent.presence != "absent" or agent.offered is None:
            return
        phase, sent_at = agent.offered
        if phase == refusal.phase and time.monotonic() - sent_at <= self.pace.deadline_s:
            agent.misses = 0

    def _handle_presence(self, event: BusEvent, barrier: PhaseBarrier[Any] | None) -> None:
        agent = self.registry.get(event.agent)
        if agent is None:
            return
        agent.has_token = event.kind == "alive"
        if agent.has_token:
            agent.joined_at = -math.inf
        elif barrier is not None:
            barrier.drop(agent.id)

    # ---------------------------------------------------------------- what answers are made of

    def _roster(self) -> RosterRecord:
        market = self.market
        return self.rosters.current(market.homes, market.specs, self.registry, market.agents)

    def _join_reply(self, agent: MarketAgent) -> JoinReply:
        first = self.state.next_to_begin()
        homes = self._admission.homes_of(agent)
        return self._join_replies.reply(agent, homes, first, self.market.sell_prices(first[0]))

    def _last_slot(self) -> SettledSlot | None:
        record = self.state.last_record
        if record is None:
            return None
        roster = self.run.roster(record.roster_version)
        return settled_slot(record, roster, self.hub.keys.run, self.scenario.dt_h, homes=False)

    def _encode_status(self, with_homes: bool) -> bytes:
        return encode(self._status.write(with_homes=with_homes))


def _collect_garbage_rarely() -> None:
    """Leave what was loaded at the start out of garbage collection, and collect the rest rarely."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)
