"""One agent's life: join, answer observation after observation, come back when the clock does, leave."""

from __future__ import annotations

import gc
import math
import secrets
import signal
import threading
import time
from abc import ABC, abstractmethod
from types import FrameType
from typing import Any, Generic, TypeVar

from zengrid import logs
from zengrid.bus.agent_link import AgentLink, ReceivedObservation
from zengrid.errors import ZengridError
from zengrid.wire.codec import encode_fields, read, read_checked
from zengrid.wire.queries import JoinReply, JoinRequest, PolicyReply, PolicyRequest
from zengrid.wire.slot_structs import FleetObservationStruct, GridObservationStruct
from zengrid_agent.learning import Learning

Seen = TypeVar("Seen", GridObservationStruct, FleetObservationStruct)

LULL_S = 0.01
"""After so long without an observation more than one can have come: this process, or its policy, stood still."""
PROMPT_HOMES = 100
"""Up to so many homes are answered on Zenoh's own thread: no wait there is noticed, and an action fits in one batch."""
LOOK_UP_S = 1.0
"""Longest that the main thread waits without a look at signals that came to another thread."""


class Stop(Exception):  # noqa: N818 - asked for, not an error
    """A signal asked this process to end."""


class AgentSession(ABC, Generic[Seen]):
    """Plays one agent until the market is over or a signal asks to stop.

    Parameters
    ----------
    link:
        The agent's connection.
    request:
        What it joins with; ``instance`` tells this process apart from others of the same name.
    learning:
        What learns beside its policy, if anything does.
    """

    observation: type[Seen]

    def __init__(self, link: AgentLink, request: JoinRequest, learning: Learning | None = None) -> None:
        self.link = link
        self.request = request
        self._learning = learning
        self._clock_seen = False
        self._busy = self._stopping = False
        self._prompt: bool | None = None
        """Whether observations are answered on Zenoh's own thread; known from the first time in the market on."""
        self._arrived = -math.inf
        """When the last observation came (monotonic clock)."""
        self._over = threading.Event()
        self._failed: Exception | None = None
        self._last: JoinReply | Seen | None = None
        """What last told day and slot."""

    @abstractmethod
    def welcome(self, market: JoinReply) -> None:
        """Get ready for the market that was joined; called again when the clock was restarted."""

    @abstractmethod
    def act(self, seen: Seen) -> dict[str, Any]:
        """What to do: the field that makes an action of what every action holds."""

    @abstractmethod
    def answer(self, request: PolicyRequest) -> PolicyReply:
        """What the policy would do."""

    def live(self) -> None:
        """Join, then answer until the market is over.

        Raises
        ------
        ZengridError
            Where the clock refuses this agent, or its policy cannot go on.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        try:
            self.join()
            self.link.serve_policy(self.answer)
            self.link.watch_clock(self._clock_changed)
            settle_down()
            if self._prompt:
                while not self._over.wait(LOOK_UP_S):
                    pass
            else:
                while self._answer_next():
                    pass
        except Stop:
            self._over.set()
            if self.request.homes:
                # Homes that came with this process leave with it.
                self.link.leave(self.request.instance)
        finally:
            if self._learning is not None:
                self._learning.save()
        if self._failed is not None:
            raise self._failed

    def join(self) -> None:
        """Take part in the market, or go on doing so under a new clock."""
        self._last = market = self.link.join(self.request)
        if self.request.unclaimed:
            homes = self.request.homes
            mine = (homes[0].model_copy(update={"id": market.agent}),) if market.brought and homes else None
            self.request = self.request.model_copy(update={"agent": market.agent, "homes": mine, "unclaimed": False})
        try:
            self.welcome(market)
        except ZengridError:
            if self.request.homes:
                self.link.leave(self.request.instance)  # what it has brought would stay without it
            raise
        if self._prompt is None:
            self._prompt = self._learning is None and len(market.homes) <= PROMPT_HOMES
        self.link.ready(self._answer_at_once if self._prompt else None)
        since = f"day {market.day}, slot {market.slot}"
        self.say(f"{self.request.agent} takes part in {market.run} ({market.scenario}) from {since} on")

    def say(self, text: str, level: logs.Level = "info") -> None:
        """One line for whoever started this process."""
        at = {} if self._last is None else {"day": self._last.day, "slot": self._last.slot}
        logs.print_message(text, level, agent=self.request.agent, **at)

    def _answer_at_once(self, arrival: ReceivedObservation) -> None:
        """Answer an observation on Zenoh's own thread, while the main thread waits for the end."""
        if self._over.is_set():
            return
        try:
            if not self._answer(arrival):
                self._end()
        except Exception as error:  # noqa: BLE001 - the main thread raises it
            self._end(error)

    def _end(self, error: Exception | None = None) -> None:
        """Let the main thread go."""
        if not self._over.is_set():
            self._failed = error
            self._over.set()

    def _answer_next(self) -> bool:
        """Wait for an observation and answer it; False when the market is over."""
        arrival = self.link.receive()
        # From here on a signal waits: what is raised within a library's call back can be taken for its own error.
        self._busy = True
        now = time.monotonic()
        if now - self._arrived > LULL_S:
            # Only the newest is still awaited.
            while arrival is not None and (newer := self.link.pending()) is not None:
                arrival = newer
        self._arrived = now
        goes_on = arrival is not None and self._answer(arrival)
        self._busy = False
        if self._stopping:
            raise Stop
        return goes_on

    def _answer(self, arrival: ReceivedObservation) -> bool:
        """Act on an observation; False where it says that the market is over."""
        self._last = seen = read(self.observation, arrival.payload, arrival.encoding)
        if seen.phase == "end":
            return False
        try:
            action = self._action(seen)
        except Exception:
            read_checked(
                self.observation, arrival.payload, arrival.encoding
            )  # says so where the observation is to blame
            raise
        self.link.act(encode_fields(action, arrival.encoding), arrival.encoding)
        if self._learning is not None:
            self._learning.reflect()  # once the action has left
        return True

    def _action(self, seen: Seen) -> dict[str, Any]:
        """The fields of ``GridAction`` or ``FleetAction``."""
        return {
            "v": 1,
            "run": seen.run,
            "day": seen.day,
            "slot": seen.slot,
            "phase": seen.phase,
            "instance": self.request.instance,
            **self.act(seen),
        }

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._stopping or not self._busy:
            raise Stop  # asked twice, it does not wait: a policy may hang
        self._stopping = True

    def _clock_changed(self, came: bool) -> None:
        if not came:
            self.say(f"{self.request.agent}: the clock is away; waiting for it", "warning")
        elif self._clock_seen:
            # A new clock may not know this process; where it does, joining again changes nothing.
            try:
                self.join()
            except ZengridError as error:
                self._end(error)
                self.link.close()
        self._clock_seen = True


def new_instance() -> str:
    """A name for this process that no other will choose."""
    return secrets.token_hex(8)


def settle_down() -> None:
    """Leave what was loaded at the start out of garbage collection, and collect the little that slots leave rarely."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)
