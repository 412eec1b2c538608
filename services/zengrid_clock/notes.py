"""Logs who came, went, hung and was served by the fallback, slot by slot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zengrid import logs

if TYPE_CHECKING:
    from zengrid_clock.roster import Presence
    from zengrid_clock.service import Clock


class Notes:
    """What the log is told of a market; costs nothing while nobody wants to know."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._known: dict[str, Presence] = {}

    def note(self, level: logs.Level, event: str, **fields: object) -> None:
        """An event of the present slot."""
        if logs.wants(level):
            logs.note(level, event, day=self._clock.day, slot=self._clock.slot, **fields)

    def slot_settled(self) -> None:
        """Compare who takes part with the slot before."""
        if not logs.wants("info"):
            return
        known, self._known = self._known, {}
        for agent in self._clock.roster:
            now = self._known[agent.id] = agent.presence
            before = known.get(agent.id, now)
            if now != before:
                event = "agent is back" if now == "present" else f"agent is {now}"
                self.note("info", event, agent=agent.id, before=before)
            if agent.last_cause:
                self.note("debug", "fallback", agent=agent.id, cause=agent.last_cause)
