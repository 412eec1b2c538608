"""What the gateway tells whoever started it."""

from __future__ import annotations

import sys


def say(text: str) -> None:
    """One line."""
    sys.stderr.write(f"zengrid gateway: {text}\n")
    sys.stderr.flush()
