"""The name of this machine, for processes that name themselves on the bus."""

from __future__ import annotations

import re
import socket


def machine_name() -> str:
    """Host name of this machine or container, reduced to characters that an agent's name may have; may be empty."""
    return re.sub(r"[^a-z0-9_-]+", "-", socket.gethostname().lower()).strip("-_")[:63]
