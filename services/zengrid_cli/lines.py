"""One line about a market, for logs and where there is no terminal."""

from __future__ import annotations

from zengrid.wire.queries import Status
from zengrid_cli.figures import change, pace, progress


def line(status: Status) -> str:
    """Where it is, how fast, prices and powers of the last slot, and the sums so far."""
    last, totals = status.last, status.totals
    parts = [f"{progress(status)}  {status.state} {pace(status)}"]
    if last is not None:
        parts.append(
            f"sell {last.sell_price:.3f} buy {last.buy_price:.3f} $/kWh  demand {last.demand_kw:,.1f} "
            f"reserve {last.facility_kw[1:].sum():,.1f} kW"
        )
    parts.append(f"profit {totals.profit:,.2f} $ ({change(totals.profit, totals.baseline_profit)})")
    parts.append(f"bills {totals.bills:,.2f} $ ({change(totals.bills, totals.baseline_bills)})")
    away = [agent.id for agent in status.agents if agent.presence != "present"]
    if away:
        parts.append(f"not there: {', '.join(away[:5])}{' ...' if len(away) > 5 else ''}")
    if status.journal_wait_s:
        parts.append(f"waiting for the journal for {status.journal_wait_s:.0f} s")
    if status.refused:
        parts.append(f"refused {sum(status.refused.values()):,}")
    return "  ".join(parts)
