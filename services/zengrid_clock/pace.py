"""How fast the market goes, and when it stands still. Pure: the time is an argument."""

from __future__ import annotations

from typing import Literal

State = Literal["waiting", "running", "paused", "ended"]


class Pace:
    """Decides when the next slot may start.

    Parameters
    ----------
    slot_s:
        Length of a slot in real time. [s]
    speed:
        Times faster than real time; 0 means as fast as answers come.
    deadline_s:
        Longest wait for the answers of one phase; with pacing at most half a slot. [s]
    """

    def __init__(self, slot_s: float, speed: float, deadline_s: float) -> None:
        self.state: State = "waiting"
        self._slot_s = slot_s
        self._longest_s = deadline_s
        self._steps = 0
        self._due = 0.0
        self.set_speed(speed, 0.0)

    def set_speed(self, speed: float, now: float) -> None:
        """Change the speed; the next slot is due one new interval from now."""
        self.speed = speed
        self.interval_s = self._slot_s / speed if speed > 0 else 0.0
        self.deadline_s = min(self._longest_s, self.interval_s / 2) if speed > 0 else self._longest_s
        self._due = now + self.interval_s

    def start(self, now: float) -> None:
        """Leave ``waiting`` or ``paused``."""
        if self.state in ("waiting", "paused"):
            self.state = "running"
            self._due = now

    def pause(self) -> None:
        """Stand still before the next slot."""
        if self.state != "ended":
            self.state = "paused"
            self._steps = 0

    def step(self, slots: int, now: float) -> None:
        """Run some slots, then stand still."""
        self.start(now)
        self._steps = slots

    def end(self) -> None:
        """No more slots."""
        self.state = "ended"

    def wait_s(self, now: float) -> float | None:
        """Time until the next slot may start; 0 means now, None until someone says so."""
        if self.state != "running":
            return None
        return max(self._due - now, 0.0)

    def began(self, now: float) -> None:
        """A slot has started: schedule the next one, without hurrying to catch up for lost time."""
        self._due = max(self._due + self.interval_s, now)

    def finished(self) -> None:
        """A slot has been settled."""
        if self._steps:
            self._steps -= 1
            if not self._steps:
                self.state = "paused"
