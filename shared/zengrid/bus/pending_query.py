"""A Zenoh query that is answered later, when its receiver gets to it."""

from __future__ import annotations

import zenoh

from zengrid.wire.codec import JSON, encode
from zengrid.wire.queries import Refusal, RefusalReason


class PendingQuery:
    """A query with its payload; it stays open until ``reply`` or ``refuse`` is called.

    Parameters
    ----------
    query:
        The query as Zenoh delivered it.
    key:
        The key to reply under, for a query that was sent to several receivers at once; by default the query's own.
    """

    def __init__(self, query: zenoh.Query, key: str | None = None) -> None:
        self._query = query
        self._key = key or query.key_expr
        self.payload = query.payload.to_bytes() if query.payload is not None else b"{}"
        self.is_closed = False

    def reply(self, payload: bytes) -> None:
        """Send the reply and close the query."""
        self.is_closed = True
        with self._query as query:
            query.reply(self._key, payload, encoding=JSON)

    def refuse(self, reason: RefusalReason, message: str) -> None:
        """Send an error reply with a ``Refusal`` and close the query."""
        self.is_closed = True
        with self._query as query:
            query.reply_err(encode(Refusal(reason=reason, message=message)), encoding=JSON)
