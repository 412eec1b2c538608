"""A spawner's side of the bus: questions, and the presence of the agents that it started."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Literal, NamedTuple, Self

import zenoh
from zenoh import handlers

from zengrid.bus.credentials import Credentials
from zengrid.bus.hub import Query
from zengrid.bus.keys import Keys, agent_of
from zengrid.bus.session import DEFAULT_ENDPOINT, open_client

SpawnerEventKind = Literal["spawn", "stop", "status", "alive", "gone"]


class SpawnerEvent(NamedTuple):
    """A question, or an agent (``clock`` included) that came or went."""

    kind: SpawnerEventKind
    agent: str
    query: Query | None


class SpawnerLink:
    """A spawner's session. Use it with ``with``.

    Parameters
    ----------
    name:
        Of the spawner, and of its certificate in the folder ``certs`` where one is given.
    on_event:
        Told everything, on Zenoh's own threads: it may only hand over.
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
        keys = Keys(run)
        self._session = open_client(
            endpoint, credentials=None if certs is None else Credentials(certs, name), timeout_s=timeout_s
        )

        def ask(kind: Literal["spawn", "stop", "status"]) -> zenoh.Queryable[None]:
            key = keys.spawner(name, kind)

            def on_query(query: zenoh.Query) -> None:
                on_event(SpawnerEvent(kind, "", Query(query, key)))

            return self._session.declare_queryable(key, handlers.Callback(on_query, indirect=False))

        def changed(sample: zenoh.Sample) -> None:
            kind: SpawnerEventKind = "alive" if sample.kind == zenoh.SampleKind.PUT else "gone"
            on_event(SpawnerEvent(kind, agent_of(str(sample.key_expr)), None))

        try:
            self._declared = [
                self._session.liveliness().declare_subscriber(
                    keys.anyone_alive, handlers.Callback(changed, indirect=False), history=True
                ),
                ask("spawn"),
                ask("stop"),
                ask("status"),
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
