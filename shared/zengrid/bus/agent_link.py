"""An agent's side of the bus: receives observations, sends actions, shows its presence, answers policy queries."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import zenoh
from zenoh import handlers

from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import KeyExpressions
from zengrid.bus.market_client import M, ask
from zengrid.bus.zenoh_session import open_client
from zengrid.errors import BusError, RefusedError, ZengridError
from zengrid.wire.base import Message
from zengrid.wire.codec import BINARY, JSON, decode, encode
from zengrid.wire.queries import (
    JoinReply,
    JoinRequest,
    LeaveReply,
    LeaveRequest,
    PolicyReply,
    PolicyRequest,
    Refusal,
    ScenarioReply,
    ScenarioRequest,
)

ATTEMPT_S = 2.0
RETRY_S = 0.1
"""Longest wait for the reply to one attempt to join, and the pause before the next attempt. [s]"""
BACKLOG = 64
"""Observations queued for an agent that is slower than the market; when the queue is full, Zenoh blocks the clock."""

_ENCODINGS = {name: zenoh.Encoding(name) for name in (JSON, BINARY)}


class ReceivedObservation(NamedTuple):
    """The bytes of an observation, in the encoding that this agent joined with."""

    payload: bytes
    encoding: str


class AgentLink:
    """One agent's session. Use it with ``with``; call ``join`` and ``ready``, then ``receive`` and ``act`` in turn.

    Parameters
    ----------
    agent:
        Name of the agent.
    run, endpoint:
        The market's run, and where its clock listens.
    certs:
        Folder of certificates; the session uses the certificate with the agent's name.
    timeout_s:
        Longest wait until the clock can be reached. [s]
    """

    def __init__(
        self,
        agent: str,
        run: str,
        endpoint: str = DEFAULT_ENDPOINT,
        *,
        certs: Path | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        self.agent = agent
        self.keys = KeyExpressions(run)
        self.timeout_s = timeout_s
        self._encoding = JSON
        self._session = open_client(
            endpoint, credentials=None if certs is None else Credentials(certs, agent), timeout_s=timeout_s
        )
        self._closed = threading.Event()
        self._token: zenoh.LivelinessToken | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session."""
        self._closed.set()
        self._session.close()

    def join(self, request: JoinRequest, timeout_s: float = 10.0) -> JoinReply:
        """Join the market. Joining again with the same instance changes nothing.

        With ``unclaimed`` this link acts for the agent that the reply names.

        Raises
        ------
        RefusedError
            With the clock's reason.
        BusError
            If the clock does not reply in time.
        """
        self._await_clock()
        self._encoding = BINARY if request.encoding == "binary" else JSON
        market = self._ask_until_answered(self.keys.join(self.agent), request, JoinReply, timeout_s)
        self.agent = market.agent
        return market

    def _ask_until_answered(self, key: str, request: Message, kind: type[M], timeout_s: float) -> M:
        """Ask the clock again while it does not reply or is busy.

        After a lost link the clock's token can be back before its queryables, and a busy clock refuses with
        "unavailable".
        """
        until = time.monotonic() + timeout_s
        while True:
            try:
                return ask(self._session, key, request, kind, ATTEMPT_S)
            except (BusError, RefusedError) as error:
                if time.monotonic() > until or (isinstance(error, RefusedError) and error.reason != "unavailable"):
                    raise
                self._closed.wait(RETRY_S)

    def _await_clock(self) -> None:
        """Wait for the clock's token: a clock listens for a while before it answers queries."""
        ready = threading.Event()

        def changed(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                ready.set()

        watching = self._session.liveliness().declare_subscriber(
            self.keys.clock_alive, handlers.Callback(changed, indirect=False), history=True
        )
        if not ready.wait(self.timeout_s):
            raise BusError(f"run = {self.keys.run}: its clock is not ready after {self.timeout_s:g} s")
        watching.undeclare()

    def ready(self, answer: Callable[[ReceivedObservation], None] | None = None) -> None:
        """Subscribe to observations and declare this agent's token: from now on the clock waits for its actions.

        Parameters
        ----------
        answer:
            Called for every observation on Zenoh's own thread, which saves two changes of thread per slot. It must
            return quickly and raise nothing. Of this link it may call only ``act``, with less than a batch (64 KiB):
            a larger action would wait there for that very thread. Without ``answer``, call ``receive``.
        """
        if self._token is not None:
            return
        self._action = self._session.declare_publisher(
            self.keys.action(self.agent), congestion_control=zenoh.CongestionControl.BLOCK, express=True
        )
        # Subscribe before the token says that this agent is ready, so that the first observation is not lost.
        key = self.keys.observation(self.agent)
        if answer is None:
            self._observations = self._session.declare_subscriber(key, handlers.FifoChannel(BACKLOG))
        else:
            self._answered = self._session.declare_subscriber(key, self._answer_callback(answer))
        self._token = self._session.liveliness().declare_token(self.keys.alive(self.agent))

    def _answer_callback(self, answer: Callable[[ReceivedObservation], None]) -> handlers.Callback[zenoh.Sample]:
        prepared_threads: set[int] = set()

        def on_observation(sample: zenoh.Sample) -> None:
            thread = threading.get_ident()
            if thread not in prepared_threads:
                # Otherwise Zenoh's thread gets a new Python thread state for every call and loses it afterwards.
                ctypes.pythonapi.PyGILState_Ensure()
                prepared_threads.add(thread)
            answer(ReceivedObservation(sample.payload.to_bytes(), self._encoding))

        return handlers.Callback(on_observation, indirect=False)

    def scenario(self, timeout_s: float = 10.0) -> str:
        """The scenario that the market plays, as YAML."""
        return ask(self._session, self.keys.scenario, ScenarioRequest(), ScenarioReply, timeout_s).yaml

    def leave(self, instance: str, timeout_s: float = 10.0) -> None:
        """Take this agent's homes out of the market.

        Raises
        ------
        RefusedError
            With the clock's reason.
        BusError
            If the clock does not reply in time.
        """
        request = LeaveRequest(agent=self.agent, instance=instance)
        try:
            self._ask_until_answered(self.keys.leave(self.agent), request, LeaveReply, timeout_s)
        except RefusedError as error:
            if error.reason != "unknown":  # an earlier request took it out, but its reply was lost
                raise

    def receive(self) -> ReceivedObservation | None:
        """Wait for an observation; None once the link is closed."""
        try:
            sample = self._observations.recv()
        except zenoh.ZError:
            return None
        return ReceivedObservation(sample.payload.to_bytes(), self._encoding)

    def pending(self) -> ReceivedObservation | None:
        """The next observation if one has already arrived, else None; does not wait."""
        sample = self._observations.try_recv()
        return None if sample is None else ReceivedObservation(sample.payload.to_bytes(), self._encoding)

    def act(self, payload: bytes, encoding: str) -> None:
        """Send the action."""
        self._action.put(payload, encoding=_ENCODINGS[encoding])

    def watch_clock(self, on_change: Callable[[bool], None]) -> None:
        """Call ``on_change`` in its own thread when the clock appears (True) or vanishes (False)."""

        def changed(sample: zenoh.Sample) -> None:
            on_change(sample.kind == zenoh.SampleKind.PUT)

        self._clock = self._session.liveliness().declare_subscriber(self.keys.clock_alive, changed, history=True)

    def serve_policy(self, answer: Callable[[PolicyRequest], PolicyReply]) -> None:
        """Answer policy queries in their own thread."""

        def on_query(query: zenoh.Query) -> None:
            with query:
                try:
                    request = decode(PolicyRequest, query.payload.to_bytes() if query.payload else b"")
                    query.reply(query.key_expr, encode(answer(request)), encoding=JSON)
                except ZengridError as error:
                    query.reply_err(encode(Refusal(reason="invalid", message=str(error))), encoding=JSON)
                except Exception as error:  # noqa: BLE001 - every query must get a reply
                    message = f"{type(error).__name__}: {error}"
                    query.reply_err(encode(Refusal(reason="unavailable", message=message)), encoding=JSON)

        self._policy = self._session.declare_queryable(self.keys.policy(self.agent), on_query, complete=True)
