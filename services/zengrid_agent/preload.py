"""Imports what agents need: processes that are forked from a process that has imported this share it."""

from __future__ import annotations

from zengrid_agent import grid, prosumer  # noqa: F401
