"""A scenario as tables: its homes, consumers, facilities and prices, and one of its days."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from zengrid import logs
from zengrid.scenario import Days, Scenario
from zengrid.scenario.profiles import resample

BLOCKS = " ▁▂▃▄▅▆▇█"
MOST_ROWS = 12
"""Largest number of homes or profiles with a row each."""


def print_scenario(scenario: Scenario, days: Days, day: int) -> None:
    """Print a scenario, and the profiles of a day."""
    console = Console()
    console.print(f"[bold]{scenario.name}[/]  {escape(logs.printable(scenario.title))}", highlight=False)
    if scenario.description:
        console.print(logs.printable(scenario.description), style="dim", markup=False, highlight=False)
    for table in (
        _summary_table(scenario, days), _home_table(scenario), _facility_table(scenario),
        _day_table(scenario, days, day, console),
    ):  # fmt: skip
        console.print()
        console.print(table)


def _table(*columns: str, title: str) -> Table:
    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left", no_wrap=True)
    return table


def _summary_table(scenario: Scenario, days: Days) -> Table:
    table = Table.grid(padding=(0, 2))
    tariff = ", ".join(f"{step.price:g} from {step.start}" for step in scenario.tariff)
    noise = scenario.noise
    off = not any((noise.cloudiness, noise.load_level, noise.load_noise))
    each = "one each" if scenario.fleets is None else f"{scenario.fleets} fleets"
    rows = {
        "slots": f"{scenario.slots_per_day} of {scenario.slot_minutes} min",
        "days": "one typical day"
        if days.count is None
        else f"{days.count}, {days.label(0)} to {days.label(days.count - 1)}",
        "import price": f"{tariff} $/kWh",
        "export price": f"{', '.join(f'{price:g}' for price in scenario.buy_prices)} $/kWh; "
        f"{scenario.baseline_buy_price:g} in the baseline",
        "noise": "none"
        if off
        else f"clouds take {noise.cloudiness:.0%}, load {noise.load_level:.0%} by day, {noise.load_noise:.0%} by slot",
        "stored energy": "reset every day" if scenario.soc_reset == "daily" else "carries over",
        "agents": f"{len(scenario.agents)} for {len(scenario.homes)} homes, {each}",
        "seed": str(scenario.seed),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _home_table(scenario: Scenario) -> Table:
    table = _table("home", "PV kW", "facing", "kWh", "kW", "SoC", "start", "load", title=f"{len(scenario.homes)} homes")
    for home in scenario.homes[:MOST_ROWS]:
        battery, load = home.battery, home.load
        facing = "as data" if home.tilt_deg is None else f"{home.tilt_deg:g}°/{home.azimuth_deg or 0:g}°"
        table.add_row(
            home.id, f"{home.pv_kw:g}", facing, f"{battery.capacity_kwh:g}",
            f"-{battery.discharge_max_kw:g}+{battery.charge_max_kw:g}",
            f"{battery.soc_min:g}-{battery.soc_max:g}", f"{battery.soc_initial:.2f}",
            (load.profile or "default") + ("" if load.scale == 1.0 else f" x{load.scale:.2f}"),
        )  # fmt: skip
    if len(scenario.homes) > MOST_ROWS:
        table.add_row(f"and {len(scenario.homes) - MOST_ROWS} more")
    return table


def _facility_table(scenario: Scenario) -> Table:
    table = _table("facility", "min kW", "max kW", "cost $/h", title="Generation, in order of dispatch")
    for facility in scenario.facilities:
        powers = ((facility.a, " P²"), (facility.b, " P"), (facility.c, ""))
        cost = " + ".join(f"{factor:g}{power}" for factor, power in powers if factor) or "0"
        table.add_row(facility.name, f"{facility.min_kw:g}", f"{facility.max_kw:g}", cost)
    return table


def _day_table(scenario: Scenario, days: Days, number: int, console: Console) -> Table:
    profile = days.day(number)
    table = _table("", "00:00 to 24:00", "peak kW", "kWh", title=f"{days.label(number)}, sum of all")
    rows = [("PV", profile.pv_kw.sum(axis=1)), ("homes' load", profile.load_kw.sum(axis=1))]
    rows += [(consumer.name, profile.consumer_kw[:, i]) for i, consumer in enumerate(scenario.consumers)]
    for name, values in rows[:MOST_ROWS]:
        energy = values.sum() * scenario.dt_h
        table.add_row(name, _sparkline(values, console.width - 45), f"{values.max():.1f}", f"{energy:.1f}")
    table.add_row("import price", _sparkline(profile.sell_price, console.width - 45), "", "")
    return table


def _sparkline(values: NDArray[np.float64], width: int) -> str:
    """A row of blocks from 0 to the highest value; slots are averaged where there are too many."""
    slots = max((n for n in range(1, len(values) + 1) if len(values) % n == 0 and n <= max(width, 12)), default=1)
    shown = resample(values, slots)
    top = float(shown.max()) or 1.0
    return "".join(BLOCKS[round(float(value) / top * (len(BLOCKS) - 1))] for value in shown)
