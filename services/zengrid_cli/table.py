"""The live view of a market for a terminal: from the clock's status to lines that fit its width and height."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from zengrid.wire.queries import AgentStatus, HomesStatus, Status
from zengrid_cli.figures import NEXT_TO_NOTHING, amount, change, pace, progress
from zengrid_cli.rows import Row, rows

FIXED_LINES = 19
"""Lines beside those of homes and events, all remarks included."""
FEWEST_HOMES = 3
"""Rows of homes in a terminal that is too small for all: what is below them is cut off."""
BAR = " ▏▎▍▌▋▊▉█"
COLOURS = {"running": "green", "waiting": "yellow", "paused": "yellow", "ended": "blue"}
PRESENCE_COLOURS = {"present": "", "absent": "yellow", "away": "red"}


@dataclass(slots=True)
class View:
    """All that is shown."""

    status: Status
    homes: HomesStatus | None = None
    """The last ones that were asked for; many homes are not asked for each time."""
    away_s: float | None = None
    """How long the clock has not answered; None while it does [s]"""
    events: Sequence[str] = field(default_factory=tuple)
    """What happened to processes lately"""
    footer: str = ""


def render(view: View, height: int) -> RenderableType:
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


def _head(view: View) -> RenderableType:
    status = view.status
    line = Table.grid(expand=True)
    line.add_column(no_wrap=True, overflow="ellipsis")
    line.add_column(justify="right", no_wrap=True)
    state = Text(f"● {status.state}", style=COLOURS[status.state])
    if view.away_s is not None:
        state = Text(f"○ away for {view.away_s:.0f} s", style="bold red")
    name = Text.assemble((status.scenario, "bold"), f" ({status.run})  ", state, f"  {pace(status)}")
    line.add_row(name, progress(status))
    return line


def _prices(status: Status) -> RenderableType:
    last = status.last
    grid = Table.grid(padding=(0, 2, 0, 0))
    for _ in range(4):
        grid.add_column(no_wrap=True)
    if last is None:
        return grid
    grid.add_row(
        f"sell {last.sell_price:.3f} $/kWh",
        f"demand {amount(last.demand_kw):>8} kW",
        f"base    {amount(last.facility_kw[0]):>8} kW",
        f"curtailed {amount(last.curtailed_kwh)} kWh",
    )
    grid.add_row(
        f"buy  {last.buy_price:.3f} $/kWh",
        f"export {amount(last.export_kw):>8} kW",
        f"reserve {amount(last.facility_kw[1:].sum()):>8} kW",
        f"unserved  {amount(last.unserved_kwh)} kWh",
    )
    return grid


def _outcome(status: Status) -> RenderableType:
    """Profit, reserve energy and bills since the start, beside those without demand response."""
    totals = status.totals
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1))
    table.add_column("since the start", no_wrap=True)
    for heading in ("now", "conventional", "difference"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=13)
    for name, unit, real, conventional, good in (
        ("grid profit", "$", totals.profit, totals.baseline_profit, 1),
        ("reserve energy", "kWh", totals.reserve_kwh, totals.baseline_reserve_kwh, -1),
        ("bills of the homes", "$", totals.bills, totals.baseline_bills, -1),
    ):
        table.add_row(
            name, f"{amount(real)} {unit}", f"{amount(conventional)} {unit}", difference(real, conventional, good)
        )
    return table


def _homes(status: Status, homes: HomesStatus, lines: int) -> RenderableType:
    listed, total = rows(status, homes, max(lines, FEWEST_HOMES))
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=0, expand=True)
    table.add_column("home" if len(listed) == len(homes.homes) else "agent", no_wrap=True, overflow="ellipsis")
    table.add_column("SoC", no_wrap=True)
    for heading in (" batt kW", "  PV kW", "load kW", "  bill $", " conv. $"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("   diff.", justify="right", no_wrap=True)
    # Whatever the width leaves.
    table.add_column(" policy", ratio=1, no_wrap=True, overflow="ellipsis")
    for row in listed:
        table.add_row(*_cells(row), end_section=row is listed[-1])
    if len(homes.homes) > 1:
        table.add_row(*_cells(total)[:-1], f" {len(homes.homes):,} homes", style="bold")
    return table


def _cells(row: Row) -> tuple[RenderableType, ...]:
    style = PRESENCE_COLOURS[row.presence]
    remark = row.policy if row.presence == "present" else row.presence
    if row.fallbacks:
        remark += f", {row.fallbacks} missed"
    return (
        Text(row.name, style=style),
        bar(row.soc),
        amount(row.battery_kw, "+"),
        amount(row.pv_kw),
        amount(row.load_kw),
        amount(row.bill),
        amount(row.baseline_bill),
        difference(row.bill, row.baseline_bill, -1, absolute=False),
        Text(f" {remark}", style=style),
    )


def bar(part: float | None, width: int = 4) -> Text:
    """A filled bar and the per cent."""
    if part is None:
        return Text("–")
    eighths = round(min(max(part, 0.0), 1.0) * width * 8)
    filled = BAR[8] * (eighths // 8) + (BAR[eighths % 8] if eighths % 8 else "")
    return Text.assemble((f"{filled:{width}}", "cyan on grey23"), f" {part:4.0%}")


def difference(real: float, conventional: float, good: int, *, absolute: bool = True) -> Text:
    """By how much it differs: green where that is better."""
    gain = real - conventional
    percent = change(real, conventional)
    style = "green" if gain * good > NEXT_TO_NOTHING else "red" if gain * good < -NEXT_TO_NOTHING else ""
    return Text(f"{amount(gain, '+')}  {percent:>8}" if absolute else percent, style=style)


def _remarks(status: Status) -> list[RenderableType]:
    lines: list[str] = []
    if status.journal_wait_s:
        lines.append(f"waiting for the journal for {status.journal_wait_s:.0f} s")
    if status.refused:
        causes = ", ".join(f"{count:,} {cause.replace('_', ' ')}" for cause, count in sorted(status.refused.items()))
        lines.append(f"refused actions: {causes}")
    absent = [agent for agent in status.agents if agent.role == "grid" and _worth_a_line(agent)]
    lines += [f"grid agent: {agent.presence}, {agent.policy}, {agent.fallbacks} missed" for agent in absent]
    latency = status.latency
    lines.append(
        f"waited for the grid {latency.price_p50_ms:.1f} ms (p99 {latency.price_p99_ms:.1f}), "
        f"homes {latency.battery_p50_ms:.1f} ms (p99 {latency.battery_p99_ms:.1f})"
    )
    return [Text(line, style="dim", no_wrap=True, overflow="ellipsis") for line in lines]


def _worth_a_line(agent: AgentStatus) -> bool:
    return agent.presence != "present" or agent.fallbacks > 0
