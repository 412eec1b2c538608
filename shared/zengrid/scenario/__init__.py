"""Scenarios: one validated file that fully describes a market, and the days it plays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from zengrid.scenario.home_spec import BatterySpec, HomeSpec, LoadSpec, homes_params

if TYPE_CHECKING:
    from zengrid.scenario.days import Days
    from zengrid.scenario.files import BUILTIN, dumps, load, loads
    from zengrid.scenario.scenario import AgentSpec, Scenario

__all__ = [
    "BUILTIN", "AgentSpec", "BatterySpec", "Days", "HomeSpec", "LoadSpec", "Scenario", "dumps", "homes_params", "load",
    "loads",
]  # fmt: skip

# An agent describes its homes and needs no scenario, so modules that read and play one are imported on first use.
_LATER = {
    "BUILTIN": "files", "dumps": "files", "load": "files", "loads": "files",
    "AgentSpec": "scenario", "Scenario": "scenario", "Days": "days",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
