"""Who takes part: which process speaks for which agent, who is present, and who is only served."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from zengrid.scenario.home import HomeSpec
from zengrid.wire.requests import JoinRequest
from zengrid_clock.barrier import Moment

if TYPE_CHECKING:
    from zengrid_clock.actions import CommandRange

Presence = Literal["present", "absent", "away"]
FallbackCause = Literal["", "deadline", "gone", "absent", "away"]

MISSES_UNTIL_ABSENT = 3
GRID = "grid"
"""The grid agent's id; no prosumer may have it."""
RESERVED = frozenset({GRID, "clock"})


@dataclass(slots=True)
class Agent:
    """One agent as the clock knows it.

    present: waited for. absent: missed several deadlines in a row, served but not waited for, back as soon as it
    answers in time. away: no process, or none that is ready.
    """

    id: str
    role: Literal["grid", "prosumer"]
    brought: bool = False
    """Whether its homes came with it (they leave with it) instead of from the scenario."""
    bringing: tuple[HomeSpec, ...] = ()
    instance: str | None = None
    bound: float = -math.inf
    """When a process joined that has not shown its token yet (monotonic clock)."""
    token: bool = False
    policy: str = ""
    observation: Literal["paper", "public"] = "public"
    encoding: Literal["json", "binary"] = "json"
    misses: int = 0
    acted: int = 0
    fallbacks: int = 0
    last_cause: FallbackCause = ""
    acted_last: bool = False
    offered: tuple[Moment, float] | None = None
    """What was last sent while absent, and when (monotonic clock)."""
    permitted: CommandRange | None = None
    settled: bool = False
    """Whether it took part in the last settled slot."""

    @property
    def presence(self) -> Presence:
        """How it is treated in the next slot."""
        if self.instance is None or not self.token:
            return "away"
        return "absent" if self.misses >= MISSES_UNTIL_ABSENT else "present"

    def bind(self, request: JoinRequest) -> None:
        """Let a process speak for this agent."""
        self.instance = request.instance
        self.bound = time.monotonic()
        self.policy = request.policy
        self.observation = request.observation
        self.encoding = request.encoding
        # Deadlines that were missed still count: joining again must not make the market wait for a silent agent anew.

    def counted(self) -> None:
        """Its action counted."""
        self.acted += 1
        self.misses = 0
        self.last_cause = ""
        self.acted_last = True

    def missed(self, cause: FallbackCause) -> None:
        """The fallback was used for it."""
        self.fallbacks += 1
        self.last_cause = cause
        self.acted_last = False
        if cause == "deadline":
            self.misses += 1

    def answered(self) -> None:
        """It shows that it can answer in time, if not for this slot: wait for it again."""
        self.misses = 0


class Roster:
    """All agents by id: the grid agent first, then the prosumers in the order of their homes."""

    def __init__(self, prosumers: Iterable[str]) -> None:
        self.grid = Agent(GRID, "grid")
        self.prosumers: dict[str, Agent] = {name: Agent(name, "prosumer") for name in prosumers}
        self.joining: dict[str, Agent] = {}
        """Agents whose homes count from the next slot on."""

    def __iter__(self) -> Iterator[Agent]:
        yield self.grid
        yield from self.prosumers.values()

    def get(self, agent: str) -> Agent | None:
        """The agent of that id, if it takes part or will from the next slot on."""
        if agent == GRID:
            return self.grid
        return self.prosumers.get(agent) or self.joining.get(agent)

    def everyone_present(self) -> bool:
        """Whether all agents are there and ready."""
        return all(agent.presence == "present" for agent in self)
