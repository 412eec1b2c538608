"""Processes on this machine: started, watched, started again when they fail, and never left behind."""

from __future__ import annotations

from zengrid.processes.signals import Signals
from zengrid.processes.spec import ProcessSpec, Restarts
from zengrid.processes.supervisor import Event, EventKind, Supervisor, describe

__all__ = ["Event", "EventKind", "ProcessSpec", "Restarts", "Signals", "Supervisor", "describe"]
