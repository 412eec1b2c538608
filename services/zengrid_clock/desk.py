"""The clock's front desk: who joins and leaves, what operators ask, and what has been settled so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from zengrid.bus.hub import Event, Query
from zengrid.errors import JournalError, WireError, ZengridError
from zengrid.rate_limit import RateLimit
from zengrid.wire.codec import decode, encode
from zengrid.wire.requests import (
    ControlRequest,
    HistoryReply,
    HistoryRequest,
    HomeLimits,
    JoinReply,
    JoinRequest,
    LeaveReply,
    LeaveRequest,
    RefusalReason,
    ScenarioReply,
    ScenarioRequest,
)
from zengrid_clock.records import roster_record, settled_slot
from zengrid_clock.roster import GRID, RESERVED, Agent
from zengrid_clock.status import status
from zengrid_clock.vacancy import vacancy

if TYPE_CHECKING:
    from zengrid.journal import Roster as RosterRecord
    from zengrid.scenario import HomeSpec
    from zengrid_clock.service import Clock


STEERED_S = 3.0
"""Longest wait of an operator for the slot to end after which a command takes effect: clients wait for 5 s."""
JOINS_PER_S, JOINS_BURST_S = 1.0, 10.0
"""How often one agent may join or leave in the long run, and how many seconds' worth at once. [1/s], [s]"""
CHANGES_LIMIT = 4096
"""Most changes that wait for a slot to end."""


class _No(Exception):  # noqa: N818 - an answer, not a fault of the program
    def __init__(self, reason: RefusalReason, message: str) -> None:
        super().__init__(message)
        self.reason: RefusalReason = reason


class _Steered(NamedTuple):
    """An operator who waits until what was asked for takes effect."""

    query: Query
    homes: bool
    """Whether the answer lists the homes."""
    until: float
    """When to answer at the latest (monotonic)."""


class Desk:
    """Answers questions; what changes the market takes effect between two slots."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.roster_version = 0
        self._roster_changed = True
        self._changes: list[Callable[[], None]] = []
        self._steered: list[_Steered] = []
        self._joins = RateLimit(JOINS_PER_S, JOINS_BURST_S)

    def answer(self, event: Event) -> None:
        """Answer one question, whatever is wrong with it."""
        assert event.query is not None
        try:
            answer = self._answer(event, event.query)
            if answer is not None:
                event.query.reply(answer)
        except _No as refusal:
            self._refuse(event, refusal.reason, str(refusal))
        except JournalError:
            raise
        except ZengridError as error:
            self._refuse(event, "invalid", str(error))

    def fail(self, event: Event, error: Exception) -> None:
        """Tell whoever asked that the clock has failed to answer."""
        self._refuse(event, "unavailable", f"the clock could not answer: {type(error).__name__}")

    def _refuse(self, event: Event, reason: RefusalReason, message: str) -> None:
        assert event.query is not None
        self.clock.refused[f"{event.kind}_{reason}"] += 1
        self.clock.notes.note("info", f"{event.kind} refused", agent=event.agent, reason=reason, why=message)
        event.query.refuse(reason, message)

    def _answer(self, event: Event, query: Query) -> bytes | None:
        """The answer, or None where it has to wait."""
        if event.kind in ("join", "leave"):
            # Before anything is read. Whoever joins too often can still leave.
            wait_s = self._joins.wait_s(f"{event.kind} {event.agent}", time.monotonic())
            if wait_s > 0.0:
                raise _No("unavailable", f"agent = {event.agent}: asks to {event.kind} too often; wait {wait_s:.1f} s")
        if event.kind == "join":
            joining = decode(JoinRequest, event.payload)
            _check_asker(event, joining.agent)
            return encode(self._join(joining))
        if event.kind == "leave":
            leaving = decode(LeaveRequest, event.payload)
            _check_asker(event, leaving.agent)
            return encode(self._leave(leaving))
        return self._control(decode(ControlRequest, event.payload), query)

    # ---------------------------------------------------------------- joining and leaving

    def _join(self, request: JoinRequest) -> JoinReply:
        if self.clock.pace.state == "ended":
            raise _No("ended", "the market is over")
        if (request.role == "grid") != (request.agent == GRID) or (
            request.role == "prosumer" and request.agent in RESERVED
        ):
            raise _No(
                "invalid",
                f"agent = {request.agent}, role = {request.role}: the grid agent, and only it, is called grid",
            )
        if request.vacancy and request.role == "prosumer":
            if self.clock.hub.agents:
                raise _No("invalid", "vacancy = true: with certificates a process plays the agent that its own names")
            request = vacancy(self.clock, request)
        agent = self.clock.roster.get(request.agent)
        if agent is None:
            agent = self._admit(request)
        elif agent.presence == "present" and agent.instance != request.instance:
            raise _No("taken", f"agent = {request.agent}: another process plays it; choose another id")
        elif request.homes is not None and tuple(request.homes) != self._specs(agent):
            known = ", ".join(spec.id for spec in self._specs(agent))
            raise _No("taken", f"agent = {request.agent}: is in the market already, with the homes {known}")
        if agent.instance != request.instance:
            self._roster_changed = True
        agent.bind(request)
        self.clock.hub.forget(agent.id)
        self.clock.notes.note("info", "agent joins", agent=agent.id, policy=request.policy, brought=agent.brought)
        return self._welcome(agent)

    def _admit(self, request: JoinRequest) -> Agent:
        """A new agent with new homes: they count from the next slot on."""
        clock = self.clock
        if not request.homes:
            names = ", ".join(list(clock.roster.prosumers)[:10]) or "none"
            raise _No(
                "unknown",
                f"agent = {request.agent}: not in the scenario, so it must bring homes; the scenario has {names}",
            )
        taken = set(clock.market.homes) | {s.id for a in clock.roster.joining.values() for s in a.bringing}
        if len(taken) + len(request.homes) > clock.settings.max_homes:
            raise _No(
                "full", f"homes = {len(taken)} + {len(request.homes)}: this market takes {clock.settings.max_homes}"
            )
        for i, spec in enumerate(request.homes):
            if spec.id in taken:
                raise _No("taken", f"homes.{i}.id = {spec.id}: is in the market already")
            taken.add(spec.id)
            if spec.id != request.agent and spec.id in clock.hub.agents:
                raise _No(
                    "not_yours", f"homes.{i}.id = {spec.id}: is the name of another agent, which has a certificate"
                )
        clock.market.check(request.homes)
        agent = Agent(request.agent, "prosumer", brought=True, bringing=request.homes)
        clock.roster.joining[agent.id] = agent
        self._when_between_slots(lambda: self._enter(agent))
        return agent

    def _enter(self, agent: Agent) -> None:
        self.clock.roster.joining.pop(agent.id, None)
        self.clock.market.add(agent.id, agent.bringing)
        self.clock.roster.prosumers[agent.id] = agent
        self._roster_changed = True

    def _leave(self, request: LeaveRequest) -> LeaveReply:
        agent = self.clock.roster.get(request.agent)
        if agent is None:
            raise _No("unknown", f"agent = {request.agent}: not in the market")
        if agent.instance != request.instance:
            raise _No("not_yours", f"agent = {request.agent}: only the process that plays it can take it out")
        if agent.role == "grid":
            raise _No("invalid", "agent = grid: the market cannot be without its grid agent")
        self._when_between_slots(lambda: self._exit(agent))
        day, slot = self._next_slot()
        return LeaveReply(day=day, slot=slot)

    def _exit(self, agent: Agent) -> None:
        if self.clock.roster.prosumers.pop(agent.id, None) is None:
            return
        self.clock.market.remove(agent.id)
        self.clock.hub.forget(agent.id)
        self._roster_changed = True
        self.clock.notes.note("info", "agent has left", agent=agent.id)

    def _welcome(self, agent: Agent) -> JoinReply:
        clock, scenario = self.clock, self.clock.scenario
        day, slot = self._next_slot()
        return JoinReply(
            run=clock.hub.keys.run,
            scenario=scenario.name,
            agent=agent.id,
            brought=agent.brought,
            day=day,
            slot=slot,
            slots_per_day=scenario.slots_per_day,
            dt_h=scenario.dt_h,
            deadline_s=clock.settings.deadline_s,
            buy_prices=tuple(scenario.buy_prices),
            battery_levels=scenario.battery_levels,
            sell_prices=tuple(clock.market.sell_prices(day)),
            soc_reset=scenario.soc_reset,
            facilities=clock.market.market.facilities.count,
            homes=tuple(_limits(spec) for spec in self._specs(agent)),
        )

    def _specs(self, agent: Agent) -> tuple[HomeSpec, ...]:
        if agent.id in self.clock.market.agents:
            return tuple(self.clock.market.specs[self.clock.market.agents[agent.id]])
        return agent.bringing

    def _next_slot(self) -> tuple[int, int]:
        clock = self.clock
        if not clock.in_slot:
            return clock.day, clock.slot
        later = clock.slot + 1
        return (clock.day, later) if later < clock.scenario.slots_per_day else (clock.day + 1, 0)

    def _when_between_slots(self, change: Callable[[], None]) -> bool:
        """Change the market now, or as soon as its slot is a fact; returns whether it is done."""
        if self.clock.in_slot or self.clock.committing:
            self._changes.append(change)
            return False
        change()
        return True

    @property
    def waiting(self) -> bool:
        """Whether something was asked for during the slot that takes effect after it."""
        return bool(self._changes)

    def apply_changes(self) -> None:
        """Let those in and out who asked during the slot, and do what operators want."""
        changes, self._changes = self._changes, []
        for change in changes:
            with self.clock.guarded():
                change()
        self._answer_steered(math.inf)

    def changed_roster(self) -> RosterRecord | None:
        """The roster, where it has changed since it was last journalled."""
        if not self._roster_changed:
            return None
        self._roster_changed = False
        self.roster_version += 1
        return roster_record(self.clock, self.roster_version)

    # ---------------------------------------------------------------- operators

    def _control(self, request: ControlRequest, query: Query) -> bytes | None:
        if request.command == "speed" and request.speed is None:
            raise WireError("speed: needs a number: times faster than real time, 0 for as fast as answers come")
        if request.command == "stop":
            self.clock.pace.end()
        elif request.command != "status":
            if len(self._changes) >= CHANGES_LIMIT:
                raise _No(
                    "unavailable", f"command = {request.command}: {CHANGES_LIMIT} changes wait for the slot to end"
                )
            if not self._when_between_slots(lambda: self._steer(request)):
                # Who is told of a pause finds the market standing still, with its last slot in the journal.
                self._steered.append(_Steered(query, request.homes, time.monotonic() + STEERED_S))
                return None
        return encode(status(self.clock, homes=request.homes))

    def _steer(self, request: ControlRequest) -> None:
        pace, now = self.clock.pace, time.monotonic()
        if request.command == "pause":
            pace.pause()
        elif request.command == "resume":
            pace.start(now)
        elif request.command == "step":
            pace.step(request.slots, now)
        elif request.speed is not None:
            pace.set_speed(request.speed, now)

    def answer_overdue(self) -> None:
        """Answer operators whose request takes long to take effect, such as in a slot with an agent that hangs."""
        if self._steered:
            self._answer_steered(time.monotonic())

    def _answer_steered(self, now: float) -> None:
        due = [each for each in self._steered if each.until <= now]
        self._steered = [each for each in self._steered if each.until > now]
        answers = {homes: encode(status(self.clock, homes=homes)) for homes in {each.homes for each in due}}
        for each in due:
            each.query.reply(answers[each.homes])

    def told_scenario(self, payload: bytes) -> bytes:
        """What is played; runs beside the market, like ``history``."""
        decode(ScenarioRequest, payload)
        return encode(ScenarioReply(run=self.clock.hub.keys.run, yaml=self.clock.scenario.dump()))

    def history(self, payload: bytes) -> bytes:
        """Settled slots from a position on; runs beside the market, in a thread of its own."""
        request = decode(HistoryRequest, payload)
        records = self.clock.run.records(since=request.since, limit=request.limit)
        slots = tuple(settled_slot(self.clock, record, homes=request.homes) for record in records)
        following = slots[-1].position + 1 if slots else request.since
        return encode(HistoryReply(run=self.clock.hub.keys.run, next=following, slots=slots))


def _check_asker(event: Event, agent: str) -> None:
    """The key says who asks, for sure where certificates are needed; the message must not say otherwise."""
    if event.agent != agent:
        raise _No("not_yours", f"agent = {agent}: asked for under the key of {event.agent}")


def _limits(spec: HomeSpec) -> HomeLimits:
    battery = spec.battery
    return HomeLimits(
        id=spec.id,
        pv_kw=spec.pv_kw,
        capacity_kwh=battery.capacity_kwh,
        charge_max_kw=battery.charge_max_kw,
        discharge_max_kw=battery.discharge_max_kw,
        soc_min=battery.soc_min,
        soc_max=battery.soc_max,
        charge_efficiency=battery.charge_efficiency,
        discharge_efficiency=battery.discharge_efficiency,
        injection_max_kw=spec.injection_max_kw,
        soc_initial=battery.soc_initial,
    )
