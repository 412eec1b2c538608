"""The clock's side of the bus: a bounded queue for all that arrives, and publishers for all that it sends."""

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

from zengrid.bus.access_list import AccessList
from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.keys import KeyExpressions, agent_of, asker_of
from zengrid.bus.pending_query import PendingQuery
from zengrid.bus.so_linger import disable_so_linger
from zengrid.bus.wake_timer import WakeTimer
from zengrid.bus.zenoh_session import open_clock
from zengrid.errors import JournalUnavailableError, ZengridError
from zengrid.wire.codec import JSON

ACTIONS_LIMIT = 4096
"""Most actions waiting for the clock; beyond this limit Zenoh blocks the sender."""
QUERIES_LIMIT = 4096
"""Most queries waiting for the clock; further queries are refused at once, and the sender may try again."""
EVENTS_LIMIT = 65_536
"""Most events waiting in all. Changes of presence may use the room above ``QUERIES_LIMIT``: Zenoh reports them once."""
_WAKE = "clock"
"""The clock sends itself an action under this name to wake up; no agent may have this name."""

BusEventKind = Literal["action", "alive", "gone", "join", "leave", "control", "second_session"]


class BusEvent(NamedTuple):
    """One event for the clock: an action, a token that appeared or vanished, a query, or an agent's second session.

    ``agent`` is the sender, guaranteed by its certificate where certificates are used; empty for an operator's query.
    """

    kind: BusEventKind
    agent: str
    payload: bytes
    encoding: str
    query: PendingQuery | None


class ClockLink:
    """The clock's session, subscriptions and publishers. Use it with ``with``."""

    def __init__(
        self, run: str, endpoint: str = DEFAULT_ENDPOINT, *, certs: Path | None = None, insecure: bool = False
    ) -> None:
        self.keys = KeyExpressions(run)
        self.agents = frozenset(() if certs is None else AccessList.load(certs).agents)
        """Agents that may take part where certificates are required; empty without certificates, when all may."""
        self.overflowed: Counter[str] = Counter()
        """Number of events that found the queue full, by cause such as ``join_overflow``."""
        self._events: deque[tuple[BusEventKind, Any]] = deque()
        self._observation: dict[str, zenoh.Publisher] = {}
        self._latest = b""
        self._links: Counter[str] = Counter()
        self._queue_lock = Lock()
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
        self._wake_timer.stop()
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
        # Actions arrive through a channel, the cheapest way to receive. Everything else is rare: it arrives by callback
        # and wakes the channel's reader.
        self._actions = session.declare_subscriber(keys.actions, handlers.FifoChannel(ACTIONS_LIMIT))
        self._wake_key = keys.action(_WAKE)
        self._wake_timer = WakeTimer(self._wake)
        self._declared: list[Any] = [
            disable_so_linger(session),
            session.info.declare_link_events_listener(handlers.Callback(self._link_changed, indirect=False)),
            session.liveliness().declare_subscriber(keys.alive_all, self._enqueue_as("alive"), history=True),
            session.declare_queryable(keys.join("*"), self._enqueue_as("join"), complete=True),
            session.declare_queryable(keys.leave("*"), self._enqueue_as("leave"), complete=True),
            session.declare_queryable(keys.control, self._enqueue_as("control"), complete=True),
            session.declare_queryable(
                keys.slot, handlers.Callback(self._reply_latest_slot, indirect=False), complete=True
            ),
        ]

    def _link_changed(self, event: zenoh.LinkEvent) -> None:
        """Report a second session with an agent's certificate: the certificate may have been stolen."""
        name = event.link.auth_identifier
        if name not in self.agents:
            return
        opened = event.kind == zenoh.SampleKind.PUT
        self._links[name] += 1 if opened else -1
        if opened and self._links[name] > 1:
            self._enqueue("second_session", name)

    def announce(self) -> None:
        """Declare the clock's token: agents join, or join again, when they see it."""
        self._declared.append(self._session.liveliness().declare_token(self.keys.clock_alive))

    def _enqueue_as(self, kind: BusEventKind) -> handlers.Callback[Any]:
        def arrived(item: Any) -> None:
            self._enqueue(kind, item)

        return handlers.Callback(arrived, indirect=False)

    def _enqueue(self, kind: BusEventKind, item: Any) -> None:
        # Runs on Zenoh's receiving threads, so it only checks whether there is room.
        is_query = isinstance(item, zenoh.Query)
        with self._queue_lock:
            room = len(self._events) < (QUERIES_LIMIT if is_query else EVENTS_LIMIT)
            if room:
                self._events.append((kind, item))
            else:
                self.overflowed[f"{kind}_overflow"] += 1
            # The reader empties the queue, so only the first event must wake it and the channel stays free.
            first = room and len(self._events) == 1
        if first:
            self._wake()
        elif is_query and not room:
            PendingQuery(item).refuse(
                "unavailable", f"{QUERIES_LIMIT} queries are waiting for the clock; try again later"
            )

    def _wake(self) -> None:
        # While the session closes there is no reader to wake.
        with suppress(zenoh.ZError):
            self._session.put(self._wake_key, b"", allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def receive(self, timeout_s: float) -> BusEvent | None:
        """Wait for the next event; None after the timeout [s] (0: do not wait), and occasionally before it."""
        if self._events:
            return self._next_event()
        sample = self._actions.try_recv()
        if sample is None:
            if timeout_s <= 0:
                return None
            self._wake_timer.set(time.monotonic() + timeout_s)
            sample = self._actions.recv()
        agent = agent_of(str(sample.key_expr))
        if agent == _WAKE:
            return self._next_event() if self._events else None
        return BusEvent("action", agent, sample.payload.to_bytes(), str(sample.encoding), None)

    def _next_event(self) -> BusEvent:
        kind, item = self._events.popleft()
        if kind == "alive":
            appeared = item.kind == zenoh.SampleKind.PUT
            return BusEvent("alive" if appeared else "gone", agent_of(str(item.key_expr)), b"", "", None)
        if kind == "second_session":
            return BusEvent(kind, item, b"", "", None)
        query = PendingQuery(item)
        asker = "" if kind == "control" else asker_of(str(item.key_expr))
        return BusEvent(kind, asker, query.payload, JSON, query)

    def observe(self, agent: str, payload: bytes, encoding: str) -> None:
        """Send an observation to an agent that is waited for; blocks while its link is full.

        The wait is bounded: a link that stays full is closed.
        """
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
        """Send an observation to an absent agent; drop it if the link is full."""
        self._session.put(
            self.keys.observation(agent), payload, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
        )

    def release_agent(self, agent: str) -> None:
        """Drop the publisher of an agent that has left, or that joins again, perhaps with another encoding."""
        publisher = self._observation.pop(agent, None)
        if publisher is not None:
            publisher.undeclare()

    def publish_slot(self, payload: bytes) -> None:
        """Publish a settled slot to everyone; late subscribers and ``get`` calls receive the latest."""
        self._latest = payload
        self._slot.put(payload)

    def _reply_latest_slot(self, query: zenoh.Query) -> None:
        with query:
            if self._latest:
                query.reply(self.keys.slot, self._latest, encoding=JSON)

    def serve_in_thread(self, key: str, answer: Callable[[bytes], bytes]) -> None:
        """Answer queries on a key in a thread of their own, so that long ones never delay the market."""

        def on_query(item: zenoh.Query) -> None:
            query = PendingQuery(item)
            try:
                query.reply(answer(query.payload))
            except ZengridError as error:
                query.refuse("unavailable" if isinstance(error, JournalUnavailableError) else "invalid", str(error))
            except Exception as error:  # noqa: BLE001 - every query must get a reply
                query.refuse("unavailable", f"{type(error).__name__}: {error}")

        self._declared.append(self._session.declare_queryable(key, on_query, complete=True))
