"""The state of a market in one line, for logs and where there is no terminal."""

from __future__ import annotations

from zengrid.wire.queries import Status
from zengrid_cli.live_view.number_format import format_change, format_pace, format_progress


def format_status(status: Status) -> str:
    """Format progress, pace, prices and powers of the last slot, and the sums so far."""
    last, totals = status.last, status.totals
    parts = [f"{format_progress(status)}  {status.state} {format_pace(status)}"]
    if last is not None:
        parts.append(
            f"import price {last.sell_price:.3f} export price {last.buy_price:.3f} $/kWh  demand {last.demand_kw:,.1f} "
            f"reserve {last.facility_kw[1:].sum():,.1f} kW"
        )
    parts.append(f"profit {totals.profit:,.2f} $ ({format_change(totals.profit, totals.baseline_profit)})")
    parts.append(f"bills {totals.bills:,.2f} $ ({format_change(totals.bills, totals.baseline_bills)})")
    missing = [agent.id for agent in status.agents if agent.presence != "present"]
    if missing:
        parts.append(f"not present: {', '.join(missing[:5])}{' ...' if len(missing) > 5 else ''}")
    if status.journal_wait_s:
        parts.append(f"waiting for the journal for {status.journal_wait_s:.0f} s")
    if status.refused:
        parts.append(f"refused {sum(status.refused.values()):,}")
    return "  ".join(parts)
