"""Draws docs/img/top.svg: what ``zengrid top`` shows of a real market, on its seventh evening.

The market is that of ``zengrid up --policy optimum --grid-policy PRICES``.

python docs/img/draw_top.py
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

from zengrid.testing import RunningMarket

PRICES = "tou:0.05,18:00=0.09,19:00=0.10,22:00=0.08,23:00=0.05"
EVENING = 6 * 24 + 20
WIDTH = 92

with RunningMarket("paper", ("--paused",), run="main") as market:
    market.start_agents("p1", "p2", "p3", policy="optimum", grid_policy=PRICES)
    market.wait_for_status(lambda status: status.state == "paused", missing="the market ready")
    market.client.control("step", slots=EVENING)
    market.wait_for_slot(EVENING - 1, timeout_s=60.0)
    market.client.control("speed", speed=1800.0)
    market.client.control("resume")
    market.wait_for_slot(EVENING)
    shown = subprocess.run(
        [sys.executable, "-m", "zengrid_cli", "top", "--once", "--connect", market.endpoint],
        env={**os.environ, "FORCE_COLOR": "1", "COLORTERM": "truecolor", "COLUMNS": str(WIDTH)},
        capture_output=True,
        text=True,
        check=True,
    ).stdout

console = Console(file=io.StringIO(), record=True, width=WIDTH)
console.print(Text.from_ansi(shown.rstrip()))
svg = console.export_svg(title="zengrid top", unique_id="zengrid-top")
# Nobody's browser shall ask another server for a font.
svg = re.sub(r"@font-face \{.*?\}\s*", "", svg, flags=re.DOTALL)
svg = re.sub(r"Fira Code, ?monospace", "ui-monospace, Menlo, Consolas, DejaVu Sans Mono, monospace", svg)
Path(__file__).with_name("top.svg").write_text(svg, encoding="utf-8")
