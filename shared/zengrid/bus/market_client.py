"""The side of operators and viewers: query the clock, agents and spawners, and follow the market."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TypeVar

import zenoh

from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.credentials import OPERATOR, Credentials
from zengrid.bus.keys import KeyExpressions, agent_of
from zengrid.bus.zenoh_session import open_client
from zengrid.errors import BusError, RefusedError
from zengrid.wire.base import Message
from zengrid.wire.codec import JSON, decode, encode
from zengrid.wire.queries import (
    ControlRequest,
    HistoryReply,
    HistoryRequest,
    PolicyReply,
    PolicyRequest,
    Refusal,
    ScenarioReply,
    ScenarioRequest,
    Status,
)
from zengrid.wire.slots import PublicSlot
from zengrid.wire.spawner_queries import (
    ProcessStatus,
    SpawnerRequest,
    SpawnerStatus,
    SpawnRequest,
    StopReply,
    StopRequest,
)

M = TypeVar("M", bound=Message)
SPAWN_S = 20.0
"""Longest wait until a process has started or ended; its spawner replies before that. [s]"""


def ask(session: zenoh.Session, key: str, message: Message, kind: type[M], timeout_s: float) -> M:
    """Send a query to a key and return the reply.

    Raises
    ------
    RefusedError
        If the other side refuses, with its reason.
    BusError
        If nobody replies in time.
    """
    replies = session.get(key, payload=encode(message), encoding=JSON, timeout=timeout_s)
    for reply in replies:
        if reply.ok is not None:
            return decode(kind, reply.ok.payload.to_bytes())
        if reply.err is not None:
            refusal = reply.err.payload.to_bytes()
            if refusal.startswith(b"{"):
                refused = decode(Refusal, refusal)
                raise RefusedError(refused.message, refused.reason)
    raise BusError(f"{key}: nobody answered within {timeout_s:g} s")


class MarketClient:
    """A session that follows and controls a market without taking part. Use it with ``with``.

    With ``certs``, a folder of certificates, it uses the certificate called ``name``.
    """

    def __init__(
        self,
        run: str,
        endpoint: str = DEFAULT_ENDPOINT,
        *,
        certs: Path | None = None,
        name: str = OPERATOR,
        timeout_s: float = 5.0,
    ) -> None:
        self.keys = KeyExpressions(run)
        self.timeout_s = timeout_s
        credentials = None if certs is None else Credentials(certs, name)
        self.session = open_client(endpoint, credentials=credentials, timeout_s=timeout_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()

    def control(
        self,
        command: Literal["pause", "resume", "step", "speed", "stop", "status"],
        *,
        slots: int = 1,
        speed: float | None = None,
        homes: bool = True,
    ) -> Status:
        """Send a control command and return the market's status; ``status`` only reads it."""
        request = ControlRequest(command=command, slots=slots, speed=speed, homes=homes)
        return ask(self.session, self.keys.control, request, Status, self.timeout_s)

    def history(self, since: int = 0, limit: int = 100, *, homes: bool = False) -> HistoryReply:
        """Up to ``limit`` settled slots from a journal position on."""
        request = HistoryRequest(since=since, limit=limit, homes=homes)
        return ask(self.session, self.keys.history, request, HistoryReply, self.timeout_s)

    def scenario(self) -> str:
        """The scenario that the market plays, as YAML."""
        return ask(self.session, self.keys.scenario, ScenarioRequest(), ScenarioReply, self.timeout_s).yaml

    def ask_policy(self, agent: str, request: PolicyRequest) -> PolicyReply:
        """Ask an agent what its policy would do."""
        return ask(self.session, self.keys.policy(agent), request, PolicyReply, self.timeout_s)

    def spawners(self) -> list[SpawnerStatus]:
        """All spawners of this market with their processes, sorted by name."""
        replies = self.session.get(
            self.keys.spawner("*", "status"),
            payload=encode(SpawnerRequest()),
            encoding=JSON,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=self.timeout_s,
        )
        found = [decode(SpawnerStatus, reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
        return sorted(found, key=lambda each: each.spawner)

    def spawn(self, spawner: str, request: SpawnRequest) -> ProcessStatus:
        """Start a prosumer process; returns once it takes part in the market."""
        return ask(self.session, self.keys.spawner(spawner, "spawn"), request, ProcessStatus, SPAWN_S)

    def stop_process(self, spawner: str, request: StopRequest) -> StopReply:
        """End a prosumer process; returns once it has left."""
        return ask(self.session, self.keys.spawner(spawner, "stop"), request, StopReply, SPAWN_S)

    def latest(self) -> PublicSlot | None:
        """The last settled slot, or None before the first."""
        for reply in self.session.get(self.keys.slot, timeout=self.timeout_s):
            if reply.ok is not None:
                return decode(PublicSlot, reply.ok.payload.to_bytes())
        return None

    def follow(self, on_slot: Callable[[bytes], None]) -> zenoh.ext.AdvancedSubscriber[None]:
        """Call ``on_slot`` in its own thread with each settled slot as JSON, starting with the latest."""
        return zenoh.ext.declare_advanced_subscriber(
            self.session,
            self.keys.slot,
            lambda sample: on_slot(sample.payload.to_bytes()),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
        )

    def watch(self, on_change: Callable[[str, bool], None]) -> zenoh.Subscriber[None]:
        """Call ``on_change`` in its own thread when an agent or the clock (``clock``) appears (True) or vanishes."""

        def changed(sample: zenoh.Sample) -> None:
            on_change(agent_of(str(sample.key_expr)), sample.kind == zenoh.SampleKind.PUT)

        return self.session.liveliness().declare_subscriber(self.keys.anyone_alive, changed, history=True)
