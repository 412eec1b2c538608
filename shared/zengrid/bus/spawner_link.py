"""A spawner's side of the bus: queries from operators, and the presence of agents."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple, Self

import zenoh
from zenoh import handlers

from zengrid.bus.addresses import DEFAULT_ENDPOINT
from zengrid.bus.credentials import Credentials
from zengrid.bus.keys import KeyExpressions, agent_of
from zengrid.bus.pending_query import PendingQuery
from zengrid.bus.zenoh_session import open_client

SpawnerEventKind = Literal["spawn", "stop", "status", "alive", "gone"]


class SpawnerEvent(NamedTuple):
    """A query, or an agent (``clock`` included) that appeared or vanished."""

    kind: SpawnerEventKind
    agent: str
    query: PendingQuery | None


class SpawnerLink:
    """A spawner's session. Use it with ``with``.

    Parameters
    ----------
    name:
        Name of the spawner, and of its certificate.
    run, endpoint:
        The market's run, and where its clock listens.
    on_event:
        Called for each event on Zenoh's own threads; it must only put the event into a queue.
    certs:
        Folder of certificates, if the market uses them.
    timeout_s:
        Longest wait until the clock can be reached. [s]
    """

    def __init__(
        self,
        name: str,
        run: str,
        endpoint: str = DEFAULT_ENDPOINT,
        *,
        on_event: Callable[[SpawnerEvent], None],
        certs: Path | None = None,
        timeout_s: float = 30.0,
    ) -> None:
        keys = KeyExpressions(run)
        self._session = open_client(
            endpoint, credentials=None if certs is None else Credentials(certs, name), timeout_s=timeout_s
        )

        def serve(kind: Literal["spawn", "stop", "status"]) -> zenoh.Queryable[None]:
            key = keys.spawner(name, kind)

            def on_query(query: zenoh.Query) -> None:
                on_event(SpawnerEvent(kind, "", PendingQuery(query, key)))

            return self._session.declare_queryable(key, handlers.Callback(on_query, indirect=False))

        def changed(sample: zenoh.Sample) -> None:
            kind: SpawnerEventKind = "alive" if sample.kind == zenoh.SampleKind.PUT else "gone"
            on_event(SpawnerEvent(kind, agent_of(str(sample.key_expr)), None))

        try:
            self._declared = [
                self._session.liveliness().declare_subscriber(
                    keys.anyone_alive, handlers.Callback(changed, indirect=False), history=True
                ),
                serve("spawn"),
                serve("stop"),
                serve("status"),
            ]
        except BaseException:
            self._session.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()
