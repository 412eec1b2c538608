"""What a gateway is started with."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from zengrid.bus.addresses import DEFAULT_ENDPOINT, is_loopback
from zengrid.bus.keys import DEFAULT_RUN
from zengrid_gateway.access import Protect


def default_tokens() -> Path:
    """Where tokens are kept unless told otherwise."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "zengrid" / "tokens.json"


@dataclass(frozen=True, slots=True)
class Settings:
    """Which market is shown, where, and to whom."""

    run: str = DEFAULT_RUN
    endpoint: str = DEFAULT_ENDPOINT
    """Of the market's clock."""
    certs: Path | None = None
    """Folder of certificates, where the market needs one."""
    host: str = "127.0.0.1"
    port: int = 8080
    journal: str | None = None
    """Where past slots can be read: a file or URL. Without it the clock is asked, and knows its own run alone."""
    policies: Path | None = None
    """Folder of policy files, which answer where their agents are gone."""
    protect: Protect | None = None
    """What needs a token; None: nothing on loopback, elsewhere writing."""
    tokens: Path = field(default_factory=default_tokens)
    rate: float | None = None
    """Requests a second of one client, 0 without limit; None: no limit on loopback, elsewhere 100."""
    origins: tuple[str, ...] = ()
    """Other sites whose pages may use this gateway."""

    @property
    def local(self) -> bool:
        """Whether it can be reached from this machine alone."""
        return is_loopback(self.host)

    @property
    def protected(self) -> Protect:
        """What needs a token."""
        return self.protect or ("nothing" if self.local else "writing")

    @property
    def rate_per_s(self) -> float:
        """Requests a second of one client."""
        return self.rate if self.rate is not None else 0.0 if self.local else 100.0
