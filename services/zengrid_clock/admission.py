"""Lets agents and their homes into the market and out of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from zengrid.wire.queries import HomeLimits, JoinReply, JoinRequest, LeaveRequest, RefusalReason
from zengrid_clock.agent_registry import GRID, RESERVED, AgentRegistry, MarketAgent
from zengrid_clock.unclaimed import choose_unclaimed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from zengrid.scenario import HomeSpec, Scenario
    from zengrid_clock.between_slots import BetweenSlots
    from zengrid_clock.event_log import EventLog
    from zengrid_clock.live_market import LiveMarket
    from zengrid_clock.slot_records import RosterVersions


class RequestRefused(Exception):  # noqa: N818 - an expected outcome, not a fault of the program
    """A request is not granted, for one reason."""

    def __init__(self, reason: RefusalReason, message: str) -> None:
        super().__init__(message)
        self.reason: RefusalReason = reason


@dataclass(frozen=True, slots=True)
class AdmissionLimits:
    """What newcomers may bring."""

    max_homes: int
    """Most homes of the market."""
    certified: frozenset[str]
    """Agents that have a certificate; empty if anyone may take part."""


class Admission:
    """Admits agents. Who is in the market changes only between two slots.

    Parameters
    ----------
    release:
        Called with the id of an agent that joins or leaves, to release what is held for sending to it.
    """

    def __init__(
        self,
        market: LiveMarket,
        registry: AgentRegistry,
        rosters: RosterVersions,
        between_slots: BetweenSlots,
        limits: AdmissionLimits,
        event_log: EventLog,
        release: Callable[[str], None],
    ) -> None:
        self._market = market
        self._registry = registry
        self._rosters = rosters
        self._between_slots = between_slots
        self._limits = limits
        self._event_log = event_log
        self._release = release

    def join(self, request: JoinRequest) -> MarketAgent:
        """Let a process play an agent; new homes count from the next slot on.

        Raises
        ------
        RequestRefused, WireError, ScenarioError
            With the reason.
        """
        if (request.role == "grid") != (request.agent == GRID) or (
            request.role == "prosumer" and request.agent in RESERVED
        ):
            raise RequestRefused(
                "invalid",
                f"agent = {request.agent}, role = {request.role}: only the grid agent is called grid",
            )
        if request.unclaimed and request.role == "prosumer":
            request = self._choose_unclaimed(request)
        agent = self._registry.get(request.agent)
        if agent is None:
            agent = self._admit(request)
        elif agent.presence == "present" and agent.instance != request.instance:
            raise RequestRefused("taken", f"agent = {request.agent}: another process plays it; choose another id")
        elif request.homes is not None and tuple(request.homes) != self.homes_of(agent):
            known = ", ".join(spec.id for spec in self.homes_of(agent))
            raise RequestRefused("taken", f"agent = {request.agent}: is in the market already, with the homes {known}")
        if agent.instance != request.instance:
            self._rosters.mark_changed()
        agent.bind(request)
        self._release(agent.id)
        self._event_log.log("info", "agent joins", agent=agent.id, policy=agent.policy, brought=agent.brought_homes)
        return agent

    def leave(self, request: LeaveRequest) -> None:
        """Take an agent and its homes out before the next slot.

        Raises
        ------
        RequestRefused
            With the reason.
        """
        agent = self._registry.get(request.agent)
        if agent is None:
            raise RequestRefused("unknown", f"agent = {request.agent}: not in the market")
        if agent.instance != request.instance:
            raise RequestRefused(
                "not_yours", f"agent = {request.agent}: only the process that plays it can take it out"
            )
        if agent.role == "grid":
            raise RequestRefused("invalid", "agent = grid: the market cannot be without its grid agent")
        self._between_slots.apply(lambda: self._remove(agent))

    def homes_of(self, agent: MarketAgent) -> tuple[HomeSpec, ...]:
        """The homes of an agent, those that have not entered the market yet included."""
        if agent.id in self._market.agents:
            return tuple(self._market.specs[self._market.agents[agent.id]])
        return agent.joining_homes

    def _choose_unclaimed(self, request: JoinRequest) -> JoinRequest:
        if self._limits.certified:
            raise RequestRefused(
                "invalid", "unclaimed = true: with certificates a process plays the agent its own names"
            )
        agents = [*self._registry.prosumers.values(), *self._registry.joining.values()]
        return choose_unclaimed(request, agents, self._market.homes)

    def _admit(self, request: JoinRequest) -> MarketAgent:
        """Accept a new agent with new homes. Counts come before contents, so that a refusal costs little."""
        if not request.homes:
            names = ", ".join(list(self._registry.prosumers)[:10]) or "none"
            raise RequestRefused(
                "unknown",
                f"agent = {request.agent}: not in the scenario, so it must bring homes; the scenario has {names}",
            )
        taken = set(self._market.homes)
        taken |= {spec.id for agent in self._registry.joining.values() for spec in agent.joining_homes}
        if len(taken) + len(request.homes) > self._limits.max_homes:
            raise RequestRefused(
                "full", f"homes = {len(taken)} + {len(request.homes)}: this market takes {self._limits.max_homes}"
            )
        for i, spec in enumerate(request.homes):
            if spec.id in taken:
                raise RequestRefused("taken", f"homes.{i}.id = {spec.id}: is in the market already")
            taken.add(spec.id)
            if spec.id != request.agent and spec.id in self._limits.certified:
                raise RequestRefused(
                    "not_yours", f"homes.{i}.id = {spec.id}: is the name of another agent, which has a certificate"
                )
        self._market.check(request.homes)
        agent = MarketAgent(request.agent, "prosumer", brought_homes=True, joining_homes=request.homes)
        self._registry.joining[agent.id] = agent
        self._between_slots.apply(lambda: self._enter(agent))
        return agent

    def _enter(self, agent: MarketAgent) -> None:
        self._registry.joining.pop(agent.id, None)
        self._market.add(agent.id, agent.joining_homes)
        self._registry.prosumers[agent.id] = agent
        self._rosters.mark_changed()

    def _remove(self, agent: MarketAgent) -> None:
        if self._registry.prosumers.pop(agent.id, None) is None:
            return
        self._market.remove(agent.id)
        self._release(agent.id)
        self._rosters.mark_changed()
        self._event_log.log("info", "agent has left", agent=agent.id)


@dataclass(frozen=True, slots=True)
class JoinReplies:
    """Writes the replies to joins: what an agent must know of a run."""

    run: str
    scenario: Scenario
    deadline_s: float

    def reply(
        self, agent: MarketAgent, homes: Sequence[HomeSpec], first: tuple[int, int], sell_prices: Sequence[float]
    ) -> JoinReply:
        """The reply to one agent.

        Parameters
        ----------
        homes:
            The agent's homes.
        first:
            Day and slot from which it counts.
        sell_prices:
            The posted tariff of that day, one price a slot. [$/kWh]
        """
        scenario = self.scenario
        return JoinReply(
            run=self.run,
            scenario=scenario.name,
            agent=agent.id,
            brought=agent.brought_homes,
            day=first[0],
            slot=first[1],
            slots_per_day=scenario.slots_per_day,
            dt_h=scenario.dt_h,
            deadline_s=self.deadline_s,
            buy_prices=tuple(scenario.buy_prices),
            battery_levels=scenario.battery_levels,
            sell_prices=tuple(sell_prices),
            baseline_buy_price=scenario.baseline_buy_price,
            soc_reset=scenario.soc_reset,
            facilities=len(scenario.facilities),
            homes=tuple(HomeLimits.of(home) for home in homes),
        )
