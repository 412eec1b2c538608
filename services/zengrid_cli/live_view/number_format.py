"""Formats the numbers of a market for a terminal: times of day, amounts, progress, pace and changes."""

from __future__ import annotations

from zengrid.wire.queries import Status

NEGLIGIBLE = 0.005
"""A change from a smaller sum has no percentage."""


def format_time(hour: float) -> str:
    """10.25 -> 10:15."""
    minutes = round(hour * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


def format_amount(value: float, sign: str = "-") -> str:
    """Format a power, an energy or money, with cents for small values; ``sign`` ``+`` also shows a plus."""
    decimals = 2 if abs(value) < 1000 else 1 if abs(value) < 100_000 else 0
    return f"{value + 0.0:{sign},.{decimals}f}"


def format_progress(status: Status) -> str:
    """Format the progress of a run: the last settled slot, and the number of all slots if it is limited."""
    last = status.last
    if last is None:
        return "before the first slot"
    of_all = "" if status.days is None else f" of {status.days * status.slots_per_day:,}"
    return f"day {last.day} {format_time(last.hour)}  slot {last.position + 1:,}{of_all}"


def format_pace(status: Status) -> str:
    """Format the speed asked for (``max``, or the factor on real time) and the settled slots per second."""
    speed = "max" if status.speed == 0 else f"{status.speed:g}x"
    rate = status.slots_per_s
    return f"{speed}  {rate:,.0f} slots/s" if rate >= 100 else f"{speed}  {rate:.3g} slots/s"


def format_change(real: float, baseline: float) -> str:
    """Format the change from the baseline in per cent; a dash if the baseline is negligible."""
    if abs(baseline) < NEGLIGIBLE:
        return "–"
    return f"{100.0 * (real - baseline) / abs(baseline):+.1f} %"
