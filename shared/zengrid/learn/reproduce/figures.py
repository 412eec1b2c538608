"""The paper's figures, drawn from a reproduction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import NDArray

from zengrid.learn.figures.style import AGENTS, DASHES, GREY, HOMES, INK, LEADER, band, legend, letter, panels, save
from zengrid.learn.reproduce.curves import Day, OverTraining
from zengrid.learn.reproduce.numbers import PAPER_FLAT_KWH, claims
from zengrid.learn.reproduce.study import CAPACITY

Floats = NDArray[np.float64]

WINDOW = 5
"""Days of training that the moving average spans."""


def waveforms(day: Day, homes: tuple[str, ...], baseline_buy_price: float, stem: Path) -> None:
    """PV and loads of the prosumers, the consumer, and the tariff."""
    figure, places = panels(3, 9.0, 2.9)
    profile, middle = day.profile, (day.hours[:-1] + day.hours[1:]) / 2.0
    first, second, third = places
    first.fill_between(middle, profile.pv_kw[:, 0], color=HOMES[1], alpha=0.25, linewidth=0, label="PV of each")
    columns = {"hour": day.hours[:-1], "pv_kw": profile.pv_kw[:, 0]}
    for place, home in enumerate(homes):
        first.plot(middle, profile.load_kw[:, place], color=_home(place), dashes=DASHES[place], label=f"load of {home}")
        columns[f"load_{home}_kw"] = profile.load_kw[:, place]
    columns["consumer_kw"] = profile.consumer_kw.sum(axis=1)
    columns["sell_price"] = profile.sell_price
    second.plot(middle, columns["consumer_kw"], color=INK)
    third.stairs(profile.sell_price, day.hours, color=INK, baseline=None, label="sell price", linewidth=1.7)
    third.axhline(baseline_buy_price, color=GREY, dashes=(1.5, 1.5), label="buy price without demand response")
    for panel, unit in zip(places, ("kW", "kW", "$/kWh"), strict=True):
        panel.set_ylabel(unit)
        panel.set_ylim(bottom=0.0)
        _hours(panel)
    letter(places, ("PV and loads of the prosumers", "load of the consumer", "prices"))
    legend(figure, places, columns=6)
    save(figure, pd.DataFrame(columns), stem)


def day(day: Day, homes: tuple[str, ...], baseline_buy_price: float, stem: Path) -> None:
    """Prices and the state of charge of each battery over a day, conventional against agents."""
    figure, places = panels(1 + len(homes), 9.0, 4.6, rows=2, sharex=True)
    sell, prices = day.profile.sell_price, day.buy_price
    columns = {"hour": day.hours, "sell_price": np.append(sell, np.nan)}
    price = places[0]
    price.stairs(
        prices.max(axis=0), day.hours, baseline=prices.min(axis=0), fill=True, color=AGENTS, alpha=0.18, linewidth=0
    )
    price.stairs(sell, day.hours, baseline=None, color=INK, linewidth=1.2, label="sell price")
    price.axhline(baseline_buy_price, color=GREY, dashes=(1.5, 1.5), label="conventional")
    agents = f"agents, seed {day.seed}"
    price.stairs(prices[day.place], day.hours, baseline=None, color=AGENTS, linewidth=1.9, label=agents)
    price.set_ylabel("$/kWh")
    price.set_ylim(bottom=0.045)
    columns |= {f"buy_price_{name}": np.append(values, np.nan) for name, values in _three(prices, day.place).items()}
    for number, (home, place) in enumerate(zip(homes, places[1:], strict=True)):
        soc = 100.0 * day.soc[..., number]
        before = 100.0 * day.baseline_soc[:, number]
        place.fill_between(
            day.hours, soc.min(axis=0), soc.max(axis=0), color=AGENTS, alpha=0.18, linewidth=0, label="all seeds"
        )
        place.plot(day.hours, before, color=GREY, dashes=(1.5, 1.5), label="conventional")
        place.plot(day.hours, soc[day.place], color=AGENTS, label=agents)
        place.set_ylabel("SoC [%]")
        place.set_ylim(0.0, 100.0)
        columns[f"soc_{home}_conventional"] = before
        columns |= {f"soc_{home}_{name}": values for name, values in _three(soc, day.place).items()}
    for place in places:
        _hours(place, label=place in places[-2:])
    letter(places, ("sell and buy price", *(f"battery of {home}" for home in homes)))
    legend(figure, places)
    save(figure, pd.DataFrame(columns), stem)


def over_training(curves: OverTraining, homes: tuple[str, ...], stem: Path) -> None:
    """Bills, profit and reserve energy on days apart from training, while it goes on."""
    figure, places = panels(3, 9.0, 3.1)
    x = curves.evaluated
    columns: dict[str, Any] = {"episodes": x}
    bills, profit, reserve = curves.conventional
    for number, home in enumerate(homes):
        colour = _home(number)
        band(places[0], x, curves.bill[..., number], colour, home, dashes=DASHES[number])
        places[0].axhline(bills[number], color=colour, linewidth=0.9, dashes=(1.5, 1.5))
        columns |= _columns(f"bill_{home}", curves.bill[..., number], bills[number])
    for place, name, values, before in (
        (places[1], "profit", curves.profit, profit), (places[2], "reserve_kwh", curves.reserve_kwh, reserve)
    ):  # fmt: skip
        band(place, x, values, AGENTS, "agents")
        place.axhline(before, color=GREY, dashes=(1.5, 1.5), label="conventional")
        columns |= _columns(name, values, before)
    for place, unit in zip(places, ("$/day", "$/day", "kWh/day"), strict=True):
        place.set_ylabel(unit)
        _episodes(place)
    letter(places, ("bills of the prosumers", "grid profit", "reserve energy"))
    legend(figure, places)
    save(figure, pd.DataFrame(columns), stem)


def learning(curves: OverTraining, homes: tuple[str, ...], stem: Path) -> None:
    """Moving average of the reward that agents accumulate in a day, while they learn."""
    figure, places = panels(2, 9.0, 3.1)
    window = min(WINDOW, len(curves.episodes))
    x = curves.episodes[window - 1 :]
    columns: dict[str, Any] = {"episodes": x}
    grid = moving_average(curves.grid_reward, window)
    band(places[0], x, grid, AGENTS, "grid agent")
    columns |= _columns("grid_reward", grid)
    for number, home in enumerate(homes):
        reward = moving_average(curves.prosumer_reward[..., number], window)
        band(places[1], x, reward, _home(number), home, dashes=DASHES[number])
        columns |= _columns(f"reward_{home}", reward)
    for place in places:
        place.set_ylabel("reward [$/day]")
        _episodes(place)
    letter(places, ("grid agent", "prosumer agents"))
    legend(figure, places)
    save(figure, pd.DataFrame(columns), stem)


def capacity(entries: list[dict[str, Any]], panel_of: dict[tuple[str, str], str], stem: Path) -> None:
    """Bills, or profit and reserve energy, over the size of every battery.

    Parameters
    ----------
    entries:
        As ``numbers.capacity`` gives them.
    panel_of:
        Title by agent and figure.
    stem:
        Path without suffix.
    """
    figure, places = panels(len(panel_of), 9.0, 3.3)
    kept = []
    for place, (agent, name) in zip(places, panel_of, strict=True):
        rows = [entry for entry in entries if (entry["agent"], entry["figure"]) == (agent, name)]
        kept += rows
        x = [row[CAPACITY] for row in rows]
        ours = {key: [row["agents"][key] for row in rows] for key in ("median", "min", "max")}
        place.axvline(PAPER_FLAT_KWH, color=GREY, linewidth=0.8, alpha=0.6)
        place.fill_between(x, ours["min"], ours["max"], color=AGENTS, alpha=0.18, linewidth=0)
        place.plot(x, [row["conventional"] for row in rows], color=GREY, dashes=(1.5, 1.5), label="conventional")
        place.plot(x, ours["median"], color=AGENTS, marker="o", label="agents (median, spread of seeds)")
        place.plot(x, [row["leader"] for row in rows], color=LEADER, dashes=(5, 2), label="leader reference")
        if name == "bill":
            best = [row["best_response"]["median"] for row in rows]
            place.plot(x, best, color=HOMES[0], linewidth=1.1, label="best response to the agents' prices")
        place.set_xlabel("capacity of every battery [kWh]")
        place.set_ylabel(rows[0]["unit"])
        place.set_xlim(0.0, max(x) * 1.04)
    letter(places, list(panel_of.values()))
    legend(figure, places)
    save(figure, pd.json_normalize(kept), stem)


def comparison(entries: list[dict[str, Any]], homes: tuple[str, ...], stem: Path) -> None:
    """The paper's five figures: the paper's, ours with their spread, and the bound."""
    figure, (place,) = panels(1, 9.0, 3.1)
    x, wide = np.arange(len(entries)), 0.27
    ours = [entry["change_percent"] for entry in entries]
    median = np.array([one["median"] for one in ours])
    whiskers = np.array([[m - one["min"], one["max"] - m] for m, one in zip(median, ours, strict=True)]).T
    place.bar(x - wide, [entry["paper_percent"] for entry in entries], wide, color=GREY, label="the paper")
    place.bar(
        x, median, wide, yerr=whiskers, color=AGENTS, label="zengrid's agents (median, spread of seeds)",
        error_kw={"ecolor": INK, "elinewidth": 1.0, "capsize": 3.0},
    )  # fmt: skip
    place.bar(x + wide, [entry["leader_percent"] for entry in entries], wide, color=LEADER, label="leader reference")
    place.axhline(0.0, color=INK, linewidth=0.8)
    place.set_xticks(
        x, [f"bill {agent}" for agent, _ in list(claims(homes))[: len(homes)]] + ["profit", "reserve energy"]
    )
    place.set_ylabel("against conventional [%]")
    place.grid(visible=False, axis="x")
    legend(figure, [place])
    save(figure, pd.json_normalize(entries), stem)


def moving_average(values: Floats, window: int) -> Floats:
    """Mean of the last ``window`` values along the second axis; shorter by ``window - 1``."""
    summed = np.cumsum(np.insert(values, 0, 0.0, axis=1), axis=1)
    return np.asarray((summed[:, window:] - summed[:, :-window]) / window)


def _home(number: int) -> str:
    return (HOMES[0], HOMES[5], HOMES[2])[number % 3]


def _three(values: Floats, place: int) -> dict[str, Floats]:
    """Over the seeds: the one that is drawn, the smallest and the largest."""
    return {"agents": values[place], "min": values.min(axis=0), "max": values.max(axis=0)}


def _columns(name: str, values: Floats, before: float | None = None) -> dict[str, Any]:
    of_all = {"median": np.median(values, axis=0), "min": values.min(axis=0), "max": values.max(axis=0)}
    columns: dict[str, Any] = {f"{name}_{key}": column for key, column in of_all.items()}
    return columns if before is None else {**columns, f"{name}_conventional": before}


def _hours(place: Axes, label: bool = True) -> None:
    place.set_xlim(0.0, 24.0)
    place.set_xticks(range(0, 25, 4))
    if label:
        place.set_xlabel("hour of the day")


def _episodes(place: Axes) -> None:
    place.set_xlabel("episodes (days) lived by each seed")
    place.set_xlim(left=0.0)
