"""How figures of a market are written: times of day, progress, pace and changes."""

from __future__ import annotations

from zengrid.wire.queries import Status

NEXT_TO_NOTHING = 0.005
"""A sum below it has no percentage."""


def clock_time(hour: float) -> str:
    """10.25 -> 10:15."""
    minutes = round(hour * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


def amount(value: float, sign: str = "-") -> str:
    """Power, energy or money, with cents as long as they matter; ``sign`` ``+`` also shows a plus."""
    decimals = 2 if abs(value) < 1000 else 1 if abs(value) < 100_000 else 0
    return f"{value + 0.0:{sign},.{decimals}f}"


def progress(status: Status) -> str:
    """How far a run is: the last settled slot, and how many of all."""
    last = status.last
    if last is None:
        return "before the first slot"
    of_all = "" if status.days is None else f" of {status.days * status.slots_per_day:,}"
    return f"day {last.day} {clock_time(last.hour)}  slot {last.position + 1:,}{of_all}"


def pace(status: Status) -> str:
    """``max``, or the factor on real time; and how fast slots really are settled."""
    speed = "max" if status.speed == 0 else f"{status.speed:g}x"
    rate = status.slots_per_s
    return f"{speed}  {rate:,.0f} slots/s" if rate >= 100 else f"{speed}  {rate:.3g} slots/s"


def change(real: float, conventional: float) -> str:
    """The difference in per cent of what it was without demand response; a dash where that is next to nothing."""
    if abs(conventional) < NEXT_TO_NOTHING:
        return "–"
    return f"{100.0 * (real - conventional) / abs(conventional):+.1f} %"
