"""The clock's side of the bus: all that arrives goes into one bounded queue, all that leaves goes out from here."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Literal, NamedTuple, Self

import zenoh
from zenoh import handlers

from zengrid.bus.access import Names
from zengrid.bus.alarm import Alarm
from zengrid.bus.keys import Keys, agent_of, asker_of
from zengrid.bus.linger import never_linger
from zengrid.bus.session import DEFAULT_ENDPOINT, open_clock
from zengrid.errors import JournalUnavailableError, ZengridError
from zengrid.wire.codec import JSON, encode
from zengrid.wire.requests import Refusal, RefusalReason

INBOX_LIMIT = 4096
"""Most actions waiting for the clock; beyond it Zenoh holds back whoever sends more."""
QUESTIONS_LIMIT = 4096
"""Most questions waiting for the clock; whoever asks beyond it is told so at once, and may ask again."""
NOTICES_LIMIT = 65_536
"""Most waiting in all. Up to here agents that came or went have room, since Zenoh says it once only."""
_WAKE = "clock"
"""The clock puts a message to itself under this agent's name to wake up; no agent may have it."""

EventKind = Literal["action", "alive", "gone", "join", "leave", "control", "second_session"]


class Query:
    """A question that is answered when its receiver gets to it; ``key`` says as whom, where it went to many."""

    def __init__(self, query: zenoh.Query, key: str | None = None) -> None:
        self._query = query
        self._key = key or query.key_expr
        self.payload = query.payload.to_bytes() if query.payload is not None else b"{}"
        self.is_closed = False

    def reply(self, payload: bytes) -> None:
        """Answer and close the question."""
        self.is_closed = True
        with self._query as query:
            query.reply(self._key, payload, encoding=JSON)

    def refuse(self, reason: RefusalReason, message: str) -> None:
        """Refuse with a reason and close the question."""
        self.is_closed = True
        with self._query as query:
            query.reply_err(encode(Refusal(reason=reason, message=message)), encoding=JSON)


class Event(NamedTuple):
    """One thing that happened: an action, a token that came or went, a question, or a second session of an agent.

    ``agent`` is who sent it; with certificates nobody else can have. Empty where an operator asks.
    """

    kind: EventKind
    agent: str
    payload: bytes
    encoding: str
    query: Query | None


class Hub:
    """The clock's session, subscriptions and publishers. Use it with ``with``."""

    def __init__(
        self, run: str, endpoint: str = DEFAULT_ENDPOINT, *, certs: Path | None = None, insecure: bool = False
    ) -> None:
        self.keys = Keys(run)
        self.agents = frozenset(() if certs is None else Names.load(certs).agents)
        """Who can take part where certificates are needed; empty where anybody can."""
        self.overflowed: Counter[str] = Counter()
        """What found no room in the queue, by cause such as ``join_overflow``."""
        self._others: deque[tuple[EventKind, Any]] = deque()
        self._observation: dict[str, zenoh.Publisher] = {}
        self._latest = b""
        self._links: Counter[str] = Counter()
        self._handing = Lock()
        self._session = open_clock(run, endpoint, certs=certs, insecure=insecure)
        try:
            self._declare()
        except BaseException:
            self._session.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._alarm.stop()
        self._session.close()

    def _declare(self) -> None:
        session, keys = self._session, self.keys
        self._slot = zenoh.ext.declare_advanced_publisher(
            session,
            keys.slot,
            encoding=JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
            cache=zenoh.ext.CacheConfig(1),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            publisher_detection=True,
        )
        # Actions come through a channel: no other way to receive costs as little. Everything else is rare, comes by
        # callback and wakes the channel's reader.
        self._actions = session.declare_subscriber(keys.actions, handlers.FifoChannel(INBOX_LIMIT))
        self._wake_key = keys.action(_WAKE)
        self._alarm = Alarm(self._wake)
        self._declared: list[Any] = [
            never_linger(session),
            session.info.declare_link_events_listener(handlers.Callback(self._link_changed, indirect=False)),
            session.liveliness().declare_subscriber(keys.alive_all, self._direct("alive"), history=True),
            session.declare_queryable(keys.join("*"), self._direct("join"), complete=True),
            session.declare_queryable(keys.leave("*"), self._direct("leave"), complete=True),
            session.declare_queryable(keys.control, self._direct("control"), complete=True),
            session.declare_queryable(keys.slot, handlers.Callback(self._answer_slot, indirect=False), complete=True),
        ]

    def _link_changed(self, event: zenoh.LinkEvent) -> None:
        """A certificate that is used twice at a time may have been stolen."""
        name = event.link.auth_identifier
        if name not in self.agents:
            return
        came = event.kind == zenoh.SampleKind.PUT
        self._links[name] += 1 if came else -1
        if came and self._links[name] > 1:
            self._hand_over("second_session", name)

    def announce(self) -> None:
        """Show that the clock is ready: agents join (again) when they see this token."""
        self._declared.append(self._session.liveliness().declare_token(self.keys.clock_alive))

    def _direct(self, kind: EventKind) -> handlers.Callback[Any]:
        def arrived(item: Any) -> None:
            self._hand_over(kind, item)

        return handlers.Callback(arrived, indirect=False)

    def _hand_over(self, kind: EventKind, item: Any) -> None:
        # Runs on Zenoh's receiving threads: decides nothing but whether there is room.
        question = isinstance(item, zenoh.Query)
        with self._handing:
            room = len(self._others) < (QUESTIONS_LIMIT if question else NOTICES_LIMIT)
            if room:
                self._others.append((kind, item))
            else:
                self.overflowed[f"{kind}_overflow"] += 1
            # Who reads goes on until nothing is left: only the first needs to wake it, and the channel stays free.
            first = room and len(self._others) == 1
        if first:
            self._wake()
        elif question and not room:
            Query(item).refuse("unavailable", f"{QUESTIONS_LIMIT} questions are waiting for the clock; ask again later")

    def _wake(self) -> None:
        # What happens while the session closes need not wake anyone.
        with suppress(zenoh.ZError):
            self._session.put(self._wake_key, b"", allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def receive(self, timeout_s: float) -> Event | None:
        """The next event; None when the time is up (0: when there is none yet), or now and then before."""
        if self._others:
            return self._other()
        sample = self._actions.try_recv()
        if sample is None:
            if timeout_s <= 0:
                return None
            self._alarm.ring_at(time.monotonic() + timeout_s)
            sample = self._actions.recv()
        agent = agent_of(str(sample.key_expr))
        if agent == _WAKE:
            return self._other() if self._others else None
        return Event("action", agent, sample.payload.to_bytes(), str(sample.encoding), None)

    def _other(self) -> Event:
        kind, item = self._others.popleft()
        if kind == "alive":
            came = item.kind == zenoh.SampleKind.PUT
            return Event("alive" if came else "gone", agent_of(str(item.key_expr)), b"", "", None)
        if kind == "second_session":
            return Event(kind, item, b"", "", None)
        query = Query(item)
        asker = "" if kind == "control" else asker_of(str(item.key_expr))
        return Event(kind, asker, query.payload, JSON, query)

    def observe(self, agent: str, payload: bytes, encoding: str) -> None:
        """Send an agent its observation; blocks while its link is full (bounded, then the link is closed)."""
        publisher = self._observation.get(agent)
        if publisher is None:
            publisher = self._session.declare_publisher(
                self.keys.observation(agent),
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
                encoding=encoding,
            )
            self._observation[agent] = publisher
        publisher.put(payload)

    def offer(self, agent: str, payload: bytes, encoding: str) -> None:
        """Send an absent agent its observation without ever waiting for it."""
        self._session.put(
            self.keys.observation(agent), payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
        )

    def forget(self, agent: str) -> None:
        """Release what is held for an agent that has left, or joins again (perhaps with another encoding)."""
        publisher = self._observation.pop(agent, None)
        if publisher is not None:
            publisher.undeclare()

    def publish_slot(self, payload: bytes) -> None:
        """Publish a settled slot to everyone; late joiners and plain ``get`` calls see the latest."""
        self._latest = payload
        self._slot.put(payload)

    def _answer_slot(self, query: zenoh.Query) -> None:
        with query:
            if self._latest:
                query.reply(self.keys.slot, self._latest, encoding=JSON)

    def serve_beside(self, key: str, answer: Callable[[bytes], bytes]) -> None:
        """Answer questions in a thread of their own, so that long ones never hold up the market."""

        def on_query(item: zenoh.Query) -> None:
            query = Query(item)
            try:
                query.reply(answer(query.payload))
            except ZengridError as error:
                query.refuse("unavailable" if isinstance(error, JournalUnavailableError) else "invalid", str(error))
            except Exception as error:  # noqa: BLE001 - the asker must get an answer, whatever went wrong
                query.refuse("unavailable", f"{type(error).__name__}: {error}")

        self._declared.append(self._session.declare_queryable(key, on_query, complete=True))
