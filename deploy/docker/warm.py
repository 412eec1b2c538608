"""Loads what services load, so that the image holds its bytecode: containers are read-only, and start in a second."""

from __future__ import annotations

import importlib

MODULES = (
    "psycopg", "pyarrow.csv", "pyarrow.parquet", "rich.console", "rich.live", "safetensors",
    "sqlalchemy.dialects.postgresql", "sqlalchemy.dialects.sqlite", "uvloop", "zengrid.journal",
    "zengrid.policy.network", "zengrid.policy.optimum", "zengrid.scenario", "zengrid_agent.grid",
    "zengrid_agent.prosumer", "zengrid.journal.table_export", "zengrid_cli.live_view.watch_market",
    "zengrid_cli.local_market.local_market",
    "zengrid_clock.live_market", "zengrid_clock.resume", "zengrid_clock.clock", "zengrid_gateway.app",
    "zengrid_gateway.server", "zengrid_spawner.service",
)  # fmt: skip

for module in MODULES:
    importlib.import_module(module)
