"""Names that a process gives itself on the bus."""

from __future__ import annotations

import re
import socket


def machine_name() -> str:
    """This machine's or container's name, as a key may hold it; empty where nothing of it can be."""
    return re.sub(r"[^a-z0-9_-]+", "-", socket.gethostname().lower()).strip("-_")[:63]
