"""The report of a reproduction: figures and one page that holds everything, with the numbers beside it."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

from zengrid.learn.figures.style import inline, style
from zengrid.learn.reproduce import curves, figures
from zengrid.learn.reproduce.numbers import PAPER_FLAT_KWH, numbers
from zengrid.learn.reproduce.study import Study
from zengrid.learn.reproduce.words import CAPTIONS, FLAT, LEFT_OPEN, TABLE

REPORT = "report.html"
RESULTS = "results.json"
NAMES = {"bill": "bill of {}", "profit": "grid profit", "reserve_kwh": "reserve energy"}


def write(study: Study, wall_s: float) -> dict[str, Any]:
    """Draw all figures and write ``results.json`` and ``report.html``; returns the results."""
    results = numbers(study, wall_s)
    draw(study, results)
    (study.folder / RESULTS).write_text(json.dumps(results, indent=1), encoding="utf-8")
    (study.folder / REPORT).write_text(page(study.folder, results), encoding="utf-8")
    return results


def draw(study: Study, results: dict[str, Any]) -> None:
    """All figures, each as PNG and SVG with its numbers as CSV."""
    folder, homes = study.folder / "figures", study.scenario.home_ids
    day, over, price = curves.one_day(study), curves.over_training(study), study.scenario.baseline_buy_price
    with style():
        figures.comparison(results["figures"], homes, folder / "comparison")
        figures.waveforms(day, homes, price, folder / "waveforms")
        figures.day(day, homes, price, folder / "day")
        figures.over_training(over, homes, folder / "over-training")
        figures.learning(over, homes, folder / "learning-curves")
        bills = {(home, "bill"): f"bill of {home}" for home in homes}
        figures.capacity(results["capacity"], bills, folder / "capacity-bills")
        grid = {("grid", "profit"): "grid profit", ("grid", "reserve_kwh"): "reserve energy"}
        figures.capacity(results["capacity"], grid, folder / "capacity-grid")


def page(folder: Path, results: dict[str, Any]) -> str:
    """One page with all figures in it: it needs nothing beside it, and no network."""
    parts = [_summary(results), _table(results), _flat(results), "<h2>Figures</h2>"]
    for number, (name, told) in enumerate(CAPTIONS.items(), 1):
        svg = inline((folder / "figures" / f"{name}.svg").read_text(encoding="utf-8"))
        links = " ".join(f'<a href="figures/{name}.{kind}">{kind}</a>' for kind in ("png", "svg", "csv"))
        caption = f"Figure {number}. {escape(told)} <small>{links}</small>"
        parts.append(f'<figure id="{name}">{svg}<figcaption>{caption}</figcaption></figure>')
    parts += ["<h2>What the paper leaves open</h2>", "<ul>", *(f"<li>{text}</li>" for text in LEFT_OPEN), "</ul>"]
    parts.append(_made(results))
    shell = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")
    return shell.replace("BODY", "\n".join(parts))


def _number(value: float | None, decimals: int, unit: str = "", sign: str = "") -> str:
    """A number that people and programs can read; a dash where there is none."""
    if value is None:
        return "–"
    return f'<data value="{value!r}">{value:{sign}.{decimals}f}{unit}</data>'


def _spread(values: dict[str, float | None], decimals: int, unit: str = "", sign: str = "") -> str:
    if values["min"] == values["max"]:
        return _number(values["median"], decimals, unit, sign)
    ends = f"{_number(values['min'], decimals, '', sign)} … {_number(values['max'], decimals, '', sign)}"
    return f"<b>{_number(values['median'], decimals, unit, sign)}</b> <small>{ends}</small>"


def _summary(results: dict[str, Any]) -> str:
    seeds = _count(len(results["seeds"]), "seed")
    return (
        f"<p>Trained from nothing with {seeds}, judged on {results['held_out_days']} days that no training saw. All "
        f"five figures of the paper are reached or beaten by <b>{results['seeds_reaching_all']} of {seeds}</b>.</p>"
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _table(results: dict[str, Any]) -> str:
    """The paper's figures, ours and the bounds side by side."""
    seeds = len(results["seeds"])
    rows = []
    for entry in results["figures"]:
        decimals = 3 if entry["figure"] == "bill" else 2
        best = "–" if "best_response" not in entry else _spread(entry["best_response_percent"], 1, " %", "+")
        gap = "–" if "gap_percent" not in entry else _spread(entry["gap_percent"], 1, " %")
        rows.append(
            f'<tr data-agent="{entry["agent"]}" data-figure="{entry["figure"]}">'
            f"<th>{NAMES[entry['figure']].format(entry['agent'])} <small>{entry['unit']}</small></th>"
            f"<td>{_number(entry['paper_percent'], 0, ' %', '+')}</td>"
            f"<td>{_spread(entry['change_percent'], 1, ' %', '+')}</td>"
            f"<td>{entry['reached_by']} of {seeds}</td>"
            f"<td>{_number(entry['leader_percent'], 1, ' %', '+')}</td>"
            f"<td>{best}</td><td>{gap}</td>"
            f"<td>{_number(entry['conventional'], decimals)}</td>"
            f"<td>{_spread(entry['agents'], decimals)}</td>"
            f"<td>{_number(entry['leader'], decimals)}</td></tr>"
        )
    heads = (
        "the paper", "ours <small>median, spread</small>", "reached by", "leader reference", "best response", "gap",
        "conventional", "ours", "leader reference",
    )  # fmt: skip
    head = "".join(f"<th>{text}</th>" for text in ("", *heads))
    short = _spread(results["grid_short_of_leader_percent"], 1, " %", "+")
    return (
        '<h2>The paper, ours, and the bound</h2><div class="wide">'
        f'<table id="figures"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
        f"<p><small>{TABLE.format(short=short)}</small></p>"
    )


def _flat(results: dict[str, Any]) -> str:
    names = {"bill": "bills of all homes", "profit": "grid profit", "reserve_kwh": "reserve energy"}
    claimed = {figure: "–" if figure == "reserve_kwh" else f"{PAPER_FLAT_KWH:g}" for figure in names}
    rows = "".join(
        f'<tr data-figure="{figure}"><th>{names[figure]}</th><td>{claimed[figure]}</td>'
        f"<td>{_spread(entry['agents'], 0)}</td><td>{_number(entry['leader'], 0)}</td>"
        f"<td>{_number(entry['conventional'], 0)}</td></tr>"
        for figure, entry in results["flat_from_kwh"].items()
    )
    heads = ("flat from, in kWh", "the paper", "ours", "leader reference", "conventional")
    head = "".join(f"<th>{text}</th>" for text in heads)
    return (
        f'<h2>Where larger batteries stop to help</h2><table id="flat"><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table><p><small>{FLAT}</small></p>"
    )


def _made(results: dict[str, Any]) -> str:
    time, machine = results["time"], results["machine"]
    told = {
        "command": f"<code>{escape(results['command'])}</code>",
        "zengrid": results["version"],
        "seeds": ", ".join(map(str, results["seeds"])),
        "time": f"{time['wall_s']:.0f} s, {time['cpu_s']:.0f} s of processor time in trainings and searches",
        "machine": ", ".join(
            [f"{machine['processors']} processors ({machine['architecture']})"]
            + [f"{name} {machine[name]}" for name in ("python", "numpy", "torch")]
        ),
        "observation": results["observation"],
    }
    rows = "".join(f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in told.items())
    settings = escape(json.dumps(results["settings"], indent=1))
    return (
        f'<h2>How it was made</h2><table id="made"><tbody>{rows}</tbody></table>'
        f"<details><summary>Learning settings</summary><pre>{settings}</pre></details>"
        '<p><small>All numbers: <a href="results.json">results.json</a>. Policies of every seed are in the folder '
        "<code>jobs</code>.</small></p>"
    )
