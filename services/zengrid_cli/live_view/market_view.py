"""The live view of a market: turns the clock's status into lines that fit the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from zengrid.wire.queries import AgentStatus, HomesStatus, Status
from zengrid_cli.live_view.home_rows import HomeRow, home_rows
from zengrid_cli.live_view.number_format import (
    NEGLIGIBLE,
    format_amount,
    format_change,
    format_pace,
    format_progress,
)

FIXED_LINES = 20
"""Number of lines other than those of homes and events, all remarks included."""
FEWEST_HOMES = 3
"""Smallest number of rows of homes: in a terminal that is too small for them, what is below is cut off."""
BAR = " ▏▎▍▌▋▊▉█"
COLOURS = {"running": "green", "waiting": "yellow", "paused": "yellow", "ended": "blue"}
PRESENCE_COLOURS = {"present": "", "absent": "yellow", "away": "red"}


@dataclass(slots=True)
class MarketView:
    """All that the live view shows."""

    status: Status
    homes: HomesStatus | None = None
    """The last ones received; if there are many homes, they are not requested every time."""
    away_s: float | None = None
    """How long the clock has not replied; None while it does [s]"""
    events: Sequence[str] = field(default_factory=tuple)
    """The latest events of processes"""
    footer: str = ""


def render(view: MarketView, height: int) -> RenderableType:
    """The whole view, in a terminal of this height."""
    status = view.status
    parts: list[RenderableType] = [_head(view), _prices(status), "", _outcome(status), ""]
    if view.homes is not None:
        parts += [_homes(status, view.homes, height - FIXED_LINES - len(view.events)), ""]
    parts += _remarks(status)
    parts += [Text(event, style="yellow", no_wrap=True, overflow="ellipsis") for event in view.events]
    if view.footer:
        parts.append(Text(view.footer, style="dim", no_wrap=True, overflow="ellipsis"))
    return Group(*parts)


def _head(view: MarketView) -> RenderableType:
    status = view.status
    line = Table.grid(expand=True)
    line.add_column(no_wrap=True, overflow="ellipsis")
    line.add_column(justify="right", no_wrap=True)
    state = Text(f"● {status.state}", style=COLOURS[status.state])
    if view.away_s is not None:
        state = Text(f"○ away for {view.away_s:.0f} s", style="bold red")
    name = Text.assemble((status.scenario, "bold"), f" ({status.run})  ", state, f"  {format_pace(status)}")
    line.add_row(name, format_progress(status))
    return line


def _prices(status: Status) -> RenderableType:
    last = status.last
    grid = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(3):
        grid.add_column(no_wrap=True)
    if last is None:
        return grid
    grid.add_row(
        f"import price {last.sell_price:.3f} $/kWh",
        f"demand {format_amount(last.demand_kw):>8} kW",
        f"base    {format_amount(last.facility_kw[0]):>8} kW",
    )
    grid.add_row(
        f"export price {last.buy_price:.3f} $/kWh",
        f"export {format_amount(last.export_kw):>8} kW",
        f"reserve {format_amount(last.facility_kw[1:].sum()):>8} kW",
    )
    grid.add_row(
        f"curtailed {format_amount(last.curtailed_kwh)} kWh",
        f"unserved {format_amount(last.unserved_kwh)} kWh",
    )
    return grid


def _outcome(status: Status) -> RenderableType:
    """Profit, reserve energy and bills since the start, beside the baseline."""
    totals = status.totals
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1))
    table.add_column("since the start", no_wrap=True)
    for heading in ("now", "baseline", "difference"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=13)
    for name, unit, real, baseline, good in (
        ("grid profit", "$", totals.profit, totals.baseline_profit, 1),
        ("reserve energy", "kWh", totals.reserve_kwh, totals.baseline_reserve_kwh, -1),
        ("bills of the homes", "$", totals.bills, totals.baseline_bills, -1),
    ):
        table.add_row(
            name,
            f"{format_amount(real)} {unit}",
            f"{format_amount(baseline)} {unit}",
            format_difference(real, baseline, good),
        )
    return table


def _homes(status: Status, homes: HomesStatus, lines: int) -> RenderableType:
    listed, total = home_rows(status, homes, max(lines, FEWEST_HOMES))
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0, expand=True)
    table.add_column("home" if len(listed) == len(homes.homes) else "agent", no_wrap=True, overflow="ellipsis")
    table.add_column("SoC", no_wrap=True)
    for heading in (" batt kW", "  PV kW", "load kW", "  bill $", " base. $"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("   diff.", justify="right", no_wrap=True)
    # The rest of the width.
    table.add_column(" policy", ratio=1, no_wrap=True, overflow="ellipsis")
    for row in listed:
        table.add_row(*_cells(row), end_section=row is listed[-1])
    if len(homes.homes) > 1:
        table.add_row(*_cells(total)[:-1], f" {len(homes.homes):,} homes", style="bold")
    return table


def _cells(row: HomeRow) -> tuple[RenderableType, ...]:
    style = PRESENCE_COLOURS[row.presence]
    remark = row.policy if row.presence == "present" else row.presence
    if row.fallbacks:
        remark += f", {row.fallbacks} missed"
    return (
        Text(row.name, style=style),
        bar(row.soc),
        format_amount(row.battery_kw, "+"),
        format_amount(row.pv_kw),
        format_amount(row.load_kw),
        format_amount(row.bill),
        format_amount(row.baseline_bill),
        format_difference(row.bill, row.baseline_bill, -1, absolute=False),
        Text(f" {remark}", style=style),
    )


def bar(part: float | None, width: int = 4) -> Text:
    """A bar and the percentage."""
    if part is None:
        return Text("–")
    eighths = round(min(max(part, 0.0), 1.0) * width * 8)
    filled = BAR[8] * (eighths // 8) + (BAR[eighths % 8] if eighths % 8 else "")
    return Text.assemble((f"{filled:{width}}", "cyan on grey23"), f" {part:4.0%}")


def format_difference(real: float, baseline: float, good: int, *, absolute: bool = True) -> Text:
    """Format the difference from the baseline: green if it is an improvement, red if not."""
    gain = real - baseline
    percent = format_change(real, baseline)
    style = "green" if gain * good > NEGLIGIBLE else "red" if gain * good < -NEGLIGIBLE else ""
    return Text(f"{format_amount(gain, '+')}  {percent:>8}" if absolute else percent, style=style)


def _remarks(status: Status) -> list[RenderableType]:
    lines: list[str] = []
    if status.journal_wait_s:
        lines.append(f"waiting for the journal for {status.journal_wait_s:.0f} s")
    if status.refused:
        causes = ", ".join(f"{count:,} {cause.replace('_', ' ')}" for cause, count in sorted(status.refused.items()))
        lines.append(f"refused actions: {causes}")
    absent = [agent for agent in status.agents if agent.role == "grid" and _needs_a_line(agent)]
    lines += [f"grid agent: {agent.presence}, {agent.policy}, {agent.fallbacks} missed" for agent in absent]
    latency = status.latency
    lines.append(
        f"waited for the grid {latency.price_p50_ms:.1f} ms (p99 {latency.price_p99_ms:.1f}), "
        f"homes {latency.battery_p50_ms:.1f} ms (p99 {latency.battery_p99_ms:.1f})"
    )
    return [Text(line, style="dim", no_wrap=True, overflow="ellipsis") for line in lines]


def _needs_a_line(agent: AgentStatus) -> bool:
    return agent.presence != "present" or agent.fallbacks > 0
