"""An agent's side of the bus: observations in, actions out, presence, and questions about its policy."""

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

from zengrid.bus.client import ask
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import Keys
from zengrid.bus.session import DEFAULT_ENDPOINT, open_client
from zengrid.errors import BusError, RefusedError, ZengridError
from zengrid.wire.codec import BINARY, JSON, decode, encode
from zengrid.wire.requests import (
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
"""Longest wait for an answer to one question to join, and the pause before the next."""
BACKLOG = 64
"""Observations kept for an agent that is slower than the market; the oldest wait, Zenoh holds back the rest."""


_ENCODINGS = {name: zenoh.Encoding(name) for name in (JSON, BINARY)}


class Arrival(NamedTuple):
    """An observation as it came, in the encoding that this agent joined with."""

    payload: bytes
    encoding: str


class AgentLink:
    """One agent's session. Use it with ``with``; call ``join`` and ``ready``, then ``receive`` and ``act`` in turn.

    With ``certs``, a folder of certificates, it shows the one that has the agent's name.
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
        self.keys = Keys(run)
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
        """Take part; raises RefusedError with the clock's reason. Joining again with the same instance is harmless.

        With ``unclaimed`` this link acts for the agent that the reply names.
        """
        self._await_clock()
        self._encoding = BINARY if request.encoding == "binary" else JSON
        until = time.monotonic() + timeout_s
        while True:
            try:
                market = ask(self._session, self.keys.join(self.agent), request, JoinReply, ATTEMPT_S)
                break
            except (BusError, RefusedError) as error:
                # After a link was lost the clock's token can be back before its questions are; and a clock that is busy
                # says so. In both cases ask again.
                if time.monotonic() > until or (isinstance(error, RefusedError) and error.reason != "unavailable"):
                    raise
                self._closed.wait(RETRY_S)
        self.agent = market.agent
        return market

    def _await_clock(self) -> None:
        """Wait for the clock's token: a clock listens for a while before it answers, and asking then finds nobody."""
        answers = threading.Event()

        def changed(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                answers.set()

        watching = self._session.liveliness().declare_subscriber(
            self.keys.clock_alive, handlers.Callback(changed, indirect=False), history=True
        )
        if not answers.wait(self.timeout_s):
            raise BusError(f"run = {self.keys.run}: its clock is not ready after {self.timeout_s:g} s")
        watching.undeclare()

    def ready(self, answer: Callable[[Arrival], None] | None = None) -> None:
        """Show that this agent answers from now on: the last thing to do before observations come.

        Parameters
        ----------
        answer:
            Called for every observation, on Zenoh's own thread: an observation comes and its action leaves without two
            changes of thread. It must be done within a moment and raise nothing. All that it may call of this link is
            ``act``, with less than a batch (64 KiB): more would wait there for that very thread. Without ``answer``,
            ``receive`` waits for observations.
        """
        if self._token is not None:
            return
        self._action = self._session.declare_publisher(
            self.keys.action(self.agent), congestion_control=zenoh.CongestionControl.BLOCK, express=True
        )
        # The subscriber stands before the token says that this agent is ready: no first observation is lost.
        key = self.keys.observation(self.agent)
        if answer is None:
            self._observations = self._session.declare_subscriber(key, handlers.FifoChannel(BACKLOG))
        else:
            self._answered = self._session.declare_subscriber(key, self._prompt(answer))
        self._token = self._session.liveliness().declare_token(self.keys.alive(self.agent))

    def _prompt(self, answer: Callable[[Arrival], None]) -> handlers.Callback[zenoh.Sample]:
        at_home: set[int] = set()

        def arrived(sample: zenoh.Sample) -> None:
            thread = threading.get_ident()
            if thread not in at_home:
                # Zenoh's thread is given a Python state for every call, and loses it again, unless it holds one.
                ctypes.pythonapi.PyGILState_Ensure()
                at_home.add(thread)
            answer(Arrival(sample.payload.to_bytes(), self._encoding))

        return handlers.Callback(arrived, indirect=False)

    def scenario(self, timeout_s: float = 10.0) -> str:
        """The scenario that the market plays, as YAML."""
        return ask(self._session, self.keys.scenario, ScenarioRequest(), ScenarioReply, timeout_s).yaml

    def leave(self, instance: str, timeout_s: float = 5.0) -> LeaveReply:
        """Take this agent's homes out of the market."""
        request = LeaveRequest(agent=self.agent, instance=instance)
        return ask(self._session, self.keys.leave(self.agent), request, LeaveReply, timeout_s)

    def receive(self) -> Arrival | None:
        """Wait for an observation; None when the link was closed."""
        try:
            sample = self._observations.recv()
        except zenoh.ZError:
            return None
        return Arrival(sample.payload.to_bytes(), self._encoding)

    def pending(self) -> Arrival | None:
        """An observation that is there already, or None."""
        sample = self._observations.try_recv()
        return None if sample is None else Arrival(sample.payload.to_bytes(), self._encoding)

    def act(self, payload: bytes, encoding: str) -> None:
        """Send the action."""
        self._action.put(payload, encoding=_ENCODINGS[encoding])

    def watch_clock(self, on_change: Callable[[bool], None]) -> None:
        """Call back, in a thread of its own, when the clock comes (True) or goes (False)."""

        def changed(sample: zenoh.Sample) -> None:
            on_change(sample.kind == zenoh.SampleKind.PUT)

        self._clock = self._session.liveliness().declare_subscriber(self.keys.clock_alive, changed, history=True)

    def serve_policy(self, answer: Callable[[PolicyRequest], PolicyReply]) -> None:
        """Answer what the policy would do, in a thread of its own."""

        def on_query(query: zenoh.Query) -> None:
            with query:
                try:
                    request = decode(PolicyRequest, query.payload.to_bytes() if query.payload else b"")
                    query.reply(query.key_expr, encode(answer(request)), encoding=JSON)
                except ZengridError as error:
                    query.reply_err(encode(Refusal(reason="invalid", message=str(error))), encoding=JSON)
                except Exception as error:  # noqa: BLE001 - the asker must get an answer, whatever went wrong
                    message = f"{type(error).__name__}: {error}"
                    query.reply_err(encode(Refusal(reason="unavailable", message=message)), encoding=JSON)

        self._policy = self._session.declare_queryable(self.keys.policy(self.agent), on_query, complete=True)
