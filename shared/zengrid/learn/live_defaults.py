"""Defaults of learning in the live market that the command line shows without loading torch."""

from __future__ import annotations

EXPLORE_SLOTS = 12_000
"""Slots over which exploration and step size fall to their final values."""
