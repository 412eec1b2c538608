"""``zengrid scenario``: show, check and export what a market is made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from zengrid import logs
from zengrid.errors import ScenarioError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console
    from rich.table import Table

    from zengrid.scenario import Days, Scenario

app = typer.Typer(help="Show, check and export scenarios.", no_args_is_help=True)

Name = Annotated[str, typer.Argument(metavar="SCENARIO", help="paper, fontana, village, city, or a YAML file.")]
Data = Annotated[Path | None, typer.Option(help="Folder or file of the measured data, where the scenario plays such.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Instead of the scenario's own.")]

_BLOCKS = " ▁▂▃▄▅▆▇█"
_SHOWN = 12


@app.command()
def show(
    scenario: Name = "paper",
    data: Data = None,
    seed: Seed = None,
    day: Annotated[int, typer.Option(min=0, help="Number of the day whose profiles are drawn.")] = 0,
) -> None:
    """Describe a scenario: its homes, consumers, facilities and prices, and one of its days."""
    from rich.console import Console
    from rich.markup import escape

    loaded, days = _load(scenario, data, seed)
    console = Console()
    console.print(f"[bold]{loaded.name}[/]  {escape(logs.printable(loaded.title))}", highlight=False)
    if loaded.description:
        console.print(logs.printable(loaded.description), style="dim", markup=False, highlight=False)
    for table in (_facts(loaded, days), _homes(loaded), _facilities(loaded), _day(loaded, days, day, console)):
        console.print()
        console.print(table)


@app.command()
def check(scenario: Name, data: Data = None) -> None:
    """Check a scenario and its data: exit code 0 if it can be played, 1 with every fault named if not."""
    from rich.console import Console

    loaded, days = _load(scenario, data, None)
    days.day(0)
    count = "a typical day" if days.count is None else f"{days.count} measured days"
    Console().print(
        f"[green]{loaded.name} is fine[/]: {len(loaded.homes)} homes, {loaded.slots_per_day} slots a day, {count}",
        highlight=False,
    )


@app.command()
def export(
    scenario: Name,
    out: Annotated[Path, typer.Option(help="Folder to write to.")],
    days: Annotated[int, typer.Option(min=1, help="How many days.")] = 1,
    first: Annotated[int, typer.Option(min=0, help="Number of the first day.")] = 0,
    format: Annotated[Literal["csv", "parquet"], typer.Option(help="What to write.")] = "csv",
    data: Data = None,
    seed: Seed = None,
) -> None:
    """Write the profiles of some days, and a scenario file that plays them."""
    from rich.console import Console

    from zengrid.scenario.day_export import export_days

    loaded, _ = _load(scenario, data, seed)
    try:
        written = export_days(loaded, days, out, format, first)
    except ScenarioError as error:
        raise _refused(error) from None
    for path in written:
        Console().print(str(path), highlight=False, soft_wrap=True)


def _load(name: str, data: Path | None, seed: int | None) -> tuple[Scenario, Days]:
    from zengrid.scenario import Days, load

    try:
        scenario = load(name, data=data, seed=seed)
        return scenario, Days(scenario)
    except ScenarioError as error:
        raise _refused(error) from None


def _refused(error: ScenarioError) -> typer.Exit:
    from rich.console import Console

    Console(stderr=True).print(logs.printable(str(error)), style="red", markup=False, highlight=False, soft_wrap=True)
    return typer.Exit(1)


def _table(*columns: str, title: str) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0)
    )
    for place, column in enumerate(columns):
        table.add_column(column, justify="right" if place else "left", no_wrap=True)
    return table


def _facts(scenario: Scenario, days: Days) -> Table:
    from rich.table import Table

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
        "sell price": f"{tariff} $/kWh",
        "buy price": f"{', '.join(f'{price:g}' for price in scenario.buy_prices)} $/kWh; "
        f"{scenario.baseline_buy_price:g} without demand response",
        "noise": "none"
        if off
        else f"clouds take {noise.cloudiness:.0%}, load {noise.load_level:.0%} by day, {noise.load_noise:.0%} by slot",
        "stored energy": "starts anew each day" if scenario.soc_reset == "daily" else "carries over",
        "agents": f"{len(scenario.agents)} for {len(scenario.homes)} homes, {each}",
        "seed": str(scenario.seed),
    }
    for name, value in rows.items():
        table.add_row(name, value)
    return table


def _homes(scenario: Scenario) -> Table:
    table = _table("home", "PV kW", "facing", "kWh", "kW", "SoC", "start", "load", title=f"{len(scenario.homes)} homes")
    for home in scenario.homes[:_SHOWN]:
        battery, load = home.battery, home.load
        facing = "as data" if home.tilt_deg is None else f"{home.tilt_deg:g}°/{home.azimuth_deg or 0:g}°"
        table.add_row(
            home.id, f"{home.pv_kw:g}", facing, f"{battery.capacity_kwh:g}",
            f"-{battery.discharge_max_kw:g}+{battery.charge_max_kw:g}",
            f"{battery.soc_min:g}-{battery.soc_max:g}", f"{battery.soc_initial:.2f}",
            (load.profile or "default") + ("" if load.scale == 1.0 else f" x{load.scale:.2f}"),
        )  # fmt: skip
    if len(scenario.homes) > _SHOWN:
        table.add_row(f"and {len(scenario.homes) - _SHOWN} more")
    return table


def _facilities(scenario: Scenario) -> Table:
    table = _table("facility", "min kW", "max kW", "cost $/h", title="Generation, in order of dispatch")
    for facility in scenario.facilities:
        powers = ((facility.a, " P²"), (facility.b, " P"), (facility.c, ""))
        cost = " + ".join(f"{factor:g}{power}" for factor, power in powers if factor) or "0"
        table.add_row(facility.name, f"{facility.min_kw:g}", f"{facility.max_kw:g}", cost)
    return table


def _day(scenario: Scenario, days: Days, number: int, console: Console) -> Table:
    profile = days.day(number)
    table = _table("", "00:00 to 24:00", "peak kW", "kWh", title=f"{days.label(number)}, all together")
    rows = [("PV", profile.pv_kw.sum(axis=1)), ("homes' load", profile.load_kw.sum(axis=1))]
    rows += [(consumer.name, profile.consumer_kw[:, i]) for i, consumer in enumerate(scenario.consumers)]
    for name, values in rows[:_SHOWN]:
        energy = values.sum() * scenario.dt_h
        table.add_row(name, _sparkline(values, console.width - 45), f"{values.max():.1f}", f"{energy:.1f}")
    table.add_row("sell price", _sparkline(profile.sell_price, console.width - 45), "", "")
    return table


def _sparkline(values: NDArray[np.float64], width: int) -> str:
    """A row of blocks from 0 to the highest value; slots are averaged where they do not fit."""
    from zengrid.scenario.profiles import resample

    slots = max((n for n in range(1, len(values) + 1) if len(values) % n == 0 and n <= max(width, 12)), default=1)
    shown = resample(values, slots)
    top = float(shown.max()) or 1.0
    return "".join(_BLOCKS[round(float(value) / top * (len(_BLOCKS) - 1))] for value in shown)
