"""Logs events of the market: who joined, left, hung, or was served by the fallback rule."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from zengrid import logs

if TYPE_CHECKING:
    from zengrid_clock.agent_registry import MarketAgent, Presence
    from zengrid_clock.run_state import RunState


class EventLog:
    """Structured log lines with day and slot. Costs nothing at log levels that are switched off."""

    def __init__(self, state: RunState) -> None:
        self._state = state
        self._presence: dict[str, Presence] = {}

    def log(self, level: logs.Level, event: str, **fields: object) -> None:
        """Log an event of the present slot."""
        if logs.is_enabled(level):
            logs.log_event(level, event, day=self._state.day, slot=self._state.slot, **fields)

    def slot_journalled(self, agents: Iterable[MarketAgent]) -> None:
        """Log every change of presence since the slot before, and every use of the fallback rule."""
        if not logs.is_enabled("info"):
            return
        known, self._presence = self._presence, {}
        for agent in agents:
            now = self._presence[agent.id] = agent.presence
            before = known.get(agent.id, now)
            if now != before:
                event = "agent is back" if now == "present" else f"agent is {now}"
                self.log("info", event, agent=agent.id, before=before)
            if agent.last_cause:
                self.log("debug", "fallback", agent=agent.id, cause=agent.last_cause)
