"""The agents of the market: which process plays each, whether the market waits for it, and how it has fared."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from zengrid.scenario.home_spec import HomeSpec
from zengrid.wire.queries import JoinRequest
from zengrid_clock.actions import CommandRange
from zengrid_clock.barrier import SlotPhase

Presence = Literal["present", "absent", "away"]
FallbackCause = Literal["", "deadline", "gone", "absent", "away"]

MISSES_UNTIL_ABSENT = 3
GRID = "grid"
"""Id of the grid agent; no prosumer may have it."""
RESERVED = frozenset({GRID, "clock"})


@dataclass(slots=True)
class MarketAgent:
    """One agent as the clock knows it.

    present: the market waits for it. absent: it missed several deadlines in a row; the fallback rule acts for it
    without a wait, until it answers in time again. away: it has no process, or none that is ready.
    """

    id: str
    role: Literal["grid", "prosumer"]
    brought_homes: bool = False
    """Whether its homes came with it, and leave with it; otherwise they belong to the scenario."""
    joining_homes: tuple[HomeSpec, ...] = ()
    """Homes that enter the market with the next slot."""
    instance: str | None = None
    """The process that plays it."""
    joined_at: float = -math.inf
    """When a process joined whose liveliness token has not appeared yet (monotonic clock). [s]"""
    has_token: bool = False
    policy: str = ""
    observation: Literal["paper", "public"] = "public"
    encoding: Literal["json", "binary"] = "json"
    misses: int = 0
    """Deadlines missed in a row."""
    acted: int = 0
    fallbacks: int = 0
    last_cause: FallbackCause = ""
    acted_last: bool = False
    offered: tuple[SlotPhase, float] | None = None
    """The last observation sent while absent: its phase, and when it was sent (monotonic clock). [s]"""
    permitted: CommandRange | None = None
    played_last_slot: bool = False
    """Whether it took part in the last settled slot."""

    @property
    def presence(self) -> Presence:
        """How the market treats it in the next slot."""
        if self.instance is None or not self.has_token:
            return "away"
        return "absent" if self.misses >= MISSES_UNTIL_ABSENT else "present"

    def bind(self, request: JoinRequest) -> None:
        """Let a process play this agent."""
        self.instance = request.instance
        self.joined_at = time.monotonic()
        self.policy = request.policy
        self.observation = request.observation
        self.encoding = request.encoding
        # The count of missed deadlines stays: joining again must not make the market wait for a silent agent.

    def count_action(self) -> None:
        """Its action counted."""
        self.acted += 1
        self.misses = 0
        self.last_cause = ""
        self.acted_last = True

    def count_fallback(self, cause: FallbackCause) -> None:
        """The fallback rule acted for it."""
        self.fallbacks += 1
        self.last_cause = cause
        self.acted_last = False
        if cause == "deadline":
            self.misses += 1


class AgentRegistry:
    """All agents by id: the grid agent first, then the prosumers in the order of their homes."""

    def __init__(self, prosumers: Iterable[str]) -> None:
        self.grid = MarketAgent(GRID, "grid")
        self.prosumers: dict[str, MarketAgent] = {name: MarketAgent(name, "prosumer") for name in prosumers}
        self.joining: dict[str, MarketAgent] = {}
        """Agents whose homes enter the market with the next slot."""

    def __iter__(self) -> Iterator[MarketAgent]:
        yield self.grid
        yield from self.prosumers.values()

    def get(self, agent: str) -> MarketAgent | None:
        """The agent of that id, if it takes part now or will from the next slot on."""
        if agent == GRID:
            return self.grid
        return self.prosumers.get(agent) or self.joining.get(agent)

    def everyone_present(self) -> bool:
        """Whether the market could wait for all agents."""
        return all(agent.presence == "present" for agent in self)
