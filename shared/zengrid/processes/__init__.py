"""Processes on this machine: started, supervised, restarted when they fail, and never left behind."""

from __future__ import annotations

from zengrid.processes.signals import Signals
from zengrid.processes.spec import ProcessSpec, Restarts
from zengrid.processes.supervisor import ProcessEvent, ProcessEventKind, Supervisor, describe

__all__ = ["ProcessEvent", "ProcessEventKind", "ProcessSpec", "Restarts", "Signals", "Supervisor", "describe"]
