"""What a gateway is started with."""

from __future__ import annotations

from dataclasses import dataclass

from zengrid.bus.keys import DEFAULT_RUN
from zengrid.bus.session import DEFAULT_ENDPOINT


@dataclass(frozen=True, slots=True)
class Settings:
    """Which market is shown, and where."""

    run: str = DEFAULT_RUN
    endpoint: str = DEFAULT_ENDPOINT
    """Of the market's clock."""
    host: str = "127.0.0.1"
    port: int = 8080
    journal: str | None = None
    """Where past slots can be read: a file or URL. Without it the clock is asked, and knows its own run alone."""
