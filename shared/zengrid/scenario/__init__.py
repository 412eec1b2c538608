"""Scenarios: one validated file that fully describes a market, and the days it plays."""

from __future__ import annotations

from zengrid.scenario.home import BatterySpec, HomeSpec, LoadSpec, homes_params

__all__ = ["BatterySpec", "HomeSpec", "LoadSpec", "homes_params"]
