"""A sweep checks everything before it trains, trains nothing twice, goes on exactly, and ends in one tidy table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("torch", reason="extra learn is not installed")

from zengrid.errors import PolicyError, ScenarioError, ZengridError
from zengrid.learn.figures.sweep import draw
from zengrid.learn.reproduce.numbers import flat
from zengrid.learn.reproduce.study import with_capacity
from zengrid.learn.run import CHECKPOINT
from zengrid.learn.sweep.axes import cells
from zengrid.learn.sweep.cell import Market, batches
from zengrid.learn.sweep.job import RESULT, do
from zengrid.learn.sweep.sweep import JOBS, Sweep, alone
from zengrid.learn.sweep.table import save
from zengrid.scenario import load
from zengrid_cli.training.run_sweep import parse_axis

PAPER = load("paper")
TINY = {"days": 2, "pool": 8, "steps": 72, "memory": 200, "hidden": (8,), "batch": 4}
SIZES = "homes.*.battery.capacity_kwh"


def sweep(folder: Path, seeds: tuple[int, ...], axes: dict[str, list[Any]] | None = None) -> Sweep:
    axes = {SIZES: [6, 12]} if axes is None else axes
    made = cells(PAPER, axes, {"homes.*.battery.initial_kwh": None, **TINY})
    return Sweep(folder, made, seeds, days=4)


def finish(it: Sweep, stop_after: int | None = None) -> int:
    """Do all jobs here; how many there were."""
    jobs, asked = it.jobs(), 0

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return stop_after is not None and asked >= stop_after

    for job in jobs:
        do(job, it.folder / JOBS / job.id, lambda share: None, stop)
    return len(jobs)


@pytest.mark.slow
def test_a_sweep_that_was_stopped_goes_on_exactly_and_trains_nothing_twice(tmp_path: Path) -> None:
    straight = sweep(tmp_path / "a", (0, 1))
    assert finish(straight) == 1  # four markets of one shape
    stopped = sweep(tmp_path / "b", (0, 1))
    finish(stopped, stop_after=1)
    assert stopped.done() == []
    assert list((tmp_path / "b").glob(f"{JOBS}/*/{CHECKPOINT}"))
    finish(stopped)
    pd.testing.assert_frame_equal(straight.table(), stopped.table())
    assert not list((tmp_path / "b").glob(f"{JOBS}/*/{CHECKPOINT}"))
    assert finish(stopped) == 0

    wider = sweep(tmp_path / "b", (0, 1, 2))
    assert len(wider.done()) == 4
    assert finish(wider) == 1
    assert len(list((tmp_path / "b").glob(f"{JOBS}/*/{RESULT}"))) == 2
    table = wider.table()
    old = table[table["seed"] < 2].reset_index(drop=True)
    pd.testing.assert_frame_equal(old, straight.table())


@pytest.mark.slow
def test_the_table_has_one_row_for_each_cell_seed_agent_and_figure(tmp_path: Path) -> None:
    axes: dict[str, list[Any]] = {"soc_reset": ["daily", "never"], "grid_hidden": [(8,), (8, 8)]}
    it = sweep(tmp_path, (0,), axes)
    assert finish(it) == 4  # none of these can be trained side by side
    table = it.table()
    assert not table.duplicated([*axes, "seed", "agent", "figure"]).any()
    assert len(table) == 4 * (2 * 3 + 5)
    bills = table[table["figure"] == "bill"]
    assert (bills["best_response"] <= bills["agents"] + 1e-9).all()
    change = 100.0 * (bills["agents"] - bills["conventional"]) / bills["conventional"].abs()
    assert np.allclose(bills["change_percent"], change)
    paths = save(table, tmp_path / "table")
    for again in (pd.read_csv(paths[0]), pd.read_parquet(paths[1])):
        assert list(again.columns) == list(table.columns)
        assert np.allclose(again["agents"], table["agents"])
    draw(table, list(axes), tmp_path / "figure")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    assert (tmp_path / "figure.svg").read_text().startswith("<?xml")
    assert len(pd.read_csv(tmp_path / "figure.csv")) == 4 * 3


@pytest.mark.parametrize(
    ("axes", "told"),
    [
        ({"homes.*.battery.capacity_kwh": [2]}, r"initial_kwh = 3: permitted 0\.2 to 1\.8 kWh"),
        ({"homes.*.battery.capacity": [2]}, r"homes\.0\.battery\.capacity: there is no such field; permitted: capac"),
        ({"buy_price": [[0.05]]}, "buy_price: no field .* did you mean buy_prices"),
        ({"grid_lr": [0.0]}, "setting grid_lr = 0.0: permitted: above 0"),
        ({"lr": ["fast"]}, "setting grid_lr = fast: input should be a valid number"),
        ({"gamma": [1.5]}, "setting grid_gamma = 1.5: permitted: 0 to 1"),
        ({"steps": [0]}, "setting steps = 0: permitted: 1 or more"),
        ({"observation": ["all"]}, "observation = all: permitted: paper, public|observation = all: permitted: public"),
        ({"preset": ["slow"]}, "preset = slow: unknown; permitted: fast, thorough, paper"),
        ({"steps": [24, 24]}, "a value stands there twice"),
        ({"steps": []}, "steps: no values"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_before_anything_is_trained(axes: dict[str, list[Any]], told: str) -> None:
    with pytest.raises(ZengridError, match=told):
        cells(PAPER, axes)


def test_batches_depend_on_the_markets_alone() -> None:
    made = cells(PAPER, {SIZES: [6, 8, 10, 12], "lr": [1e-3, 1e-4]}, {"homes.*.battery.initial_kwh": None})
    markets = [Market(cell, seed, 4) for cell in made for seed in range(3)]
    found = batches(markets, most=5)
    assert [len(batch) for batch in found] == [4, 4, 4, 4, 4, 4]
    assert all(len({market.cell.shape for market in batch}) == 1 for batch in found)
    assert len({market.key for market in markets}) == len(markets)


def test_one_process_at_a_time_works_in_a_folder(tmp_path: Path) -> None:
    with alone(tmp_path / "a"), pytest.raises(PolicyError, match="another process works in it"), alone(tmp_path / "a"):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(PolicyError, match="cannot be written to"), alone(tmp_path / "file"):
        pass


def test_values_on_the_command_line() -> None:
    assert parse_axis("homes.*.battery.capacity_kwh=2,4.5") == ("homes.*.battery.capacity_kwh", [2, 4.5])
    assert parse_axis("hidden=[64,64],[32]") == ("hidden", [(64, 64), (32,)])
    assert parse_axis("soc_reset=daily,never") == ("soc_reset", ["daily", "never"])
    for wrong in ("steps", "=1", "steps=", "steps=1,,2"):
        with pytest.raises(PolicyError, match="give PATH=V1,V2"):
            parse_axis(wrong)


def test_batteries_of_any_size_begin_the_day_with_the_same_usable_energy() -> None:
    for size in (2.0, 6.0, 25.0):
        for home, own in zip(with_capacity(PAPER, size).homes, PAPER.homes, strict=True):
            usable = (home.battery.soc_initial - home.battery.soc_min) * size
            wanted = (own.battery.soc_initial - own.battery.soc_min) * own.battery.capacity_kwh
            assert usable == pytest.approx(min(wanted, 0.8 * size))


def test_a_curve_is_flat_from_where_it_stays_near_its_end() -> None:
    size = np.array([2.0, 5.0, 10.0, 15.0, 25.0])
    assert flat(size, np.array([0.0, 5.0, 8.9, 9.6, 10.0])) == 15.0
    assert flat(size, np.array([0.0, 10.0, 8.0, 10.0, 10.0])) == 15.0
    assert flat(size, np.full(5, 3.0)) == 2.0


def test_a_scenario_error_names_the_scenario() -> None:
    with pytest.raises(ScenarioError, match="slot_minutes = 7"):
        cells(PAPER, {"slot_minutes": [7]})
