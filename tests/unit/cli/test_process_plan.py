"""Which processes a market is made of, and that the services understand how they are started."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

import pytest

from zengrid.processes import ProcessSpec
from zengrid.scenario import load
from zengrid_cli.commands.up_command import parser as up_parser
from zengrid_cli.local_market.process_plan import ProcessPlan

ENDPOINT = "tcp/127.0.0.1:7500"


def plan(*words: str) -> ProcessPlan:
    return ProcessPlan(up_parser().parse_args(words), ENDPOINT)


def understood(spec: ProcessSpec) -> argparse.Namespace:
    """What the service makes of its command line."""
    parser = import_module(f"{spec.module}.__main__").parser()
    options: argparse.Namespace = parser.parse_args([*spec.arguments, *spec.again])
    return options


def test_the_clock_gets_all_its_options() -> None:
    spec = plan(
        "fontana", "--data", "homes", "--days", "7", "--seed", "3", "--speed", "0.1x", "--deadline", "1.5", "--paused",
        "--journal", "j.db", "--durability", "full", "--run", "north",
    ).clock()  # fmt: skip
    it = understood(spec)
    assert (it.scenario, it.data, it.days, it.seed, it.speed) == ("fontana", Path("homes"), 7, 3, 0.1)
    assert (it.deadline, it.paused, it.journal, it.durability, it.run) == (1.5, True, "j.db", "full", "north")
    assert (it.listen, it.insecure, it.resume) == (ENDPOINT, False, True)
    assert "--resume" not in spec.arguments
    assert spec.log == Path("runs/north/clock.log")


def test_the_defaults_are_those_of_the_clock() -> None:
    it, bare = understood(plan().clock()), understood(ProcessSpec("clock", "zengrid_clock"))
    for name in ("scenario", "data", "days", "seed", "speed", "deadline", "paused", "journal", "durability", "run"):
        assert getattr(it, name) == getattr(bare, name)
    assert up_parser().parse_args([]).listen == bare.listen


def test_one_process_an_agent() -> None:
    specs = plan("--policy", "random:7", "--grid-policy", "fixed:0.07").agents(load("paper"))
    assert [spec.title for spec in specs] == [
        "zengrid grid", "zengrid prosumer p1", "zengrid prosumer p2", "zengrid prosumer p3",
    ]  # fmt: skip
    grid, p1 = understood(specs[0]), understood(specs[1])
    assert (grid.role, grid.policy, grid.connect) == ("grid", "fixed:0.07", ENDPOINT)
    assert (p1.role, p1.id, p1.policy, p1.encoding) == ("prosumer", "p1", "random:7", "json")


def test_large_fleets_use_the_compact_encoding() -> None:
    for scenario, encoding in (("village", "json"), ("city", "binary")):
        specs = plan(scenario).agents(load(scenario))
        assert {understood(spec).encoding for spec in specs[1:]} == {encoding}


def test_the_gateway_and_the_table() -> None:
    gateway = plan("--journal", "j.db").gateway(8081)
    assert gateway.arguments[0] == "zengrid_gateway"
    wanted = understood(ProcessSpec("gateway", "zengrid_gateway", gateway.arguments[1:]))
    assert (wanted.port, wanted.connect, wanted.journal) == (8081, ENDPOINT, "j.db")
    spawner = plan().spawner()
    assert spawner.arguments[0] == "zengrid_spawner"
    wanted = understood(ProcessSpec("spawner", "zengrid_spawner", spawner.arguments[1:]))
    assert (wanted.connect, wanted.logs) == (ENDPOINT, Path("runs/main/spawner"))
    top = (
        import_module("zengrid_cli.commands.top_command")
        .parser()
        .parse_args(plan().table("http://x", live=False).arguments)
    )
    assert (top.plain, top.where, top.connect) == (True, "http://x", ENDPOINT)


@pytest.mark.parametrize(
    "words",
    [
        ["--speed", "fast"], ["--speed", "0"], ["--days", "0"], ["--days", "x"], ["--http", "0"], ["--http", "70000"],
        ["--deadline", "0"], ["--http", "80", "--no-http"], ["--plain", "--quiet"],
    ],
)  # fmt: skip
def test_wrong_options_are_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        up_parser().parse_args(words)
    error = capsys.readouterr().err
    assert error.startswith("zengrid up: --")
    assert error.count("\n") == 1


def test_agents_are_told_how_to_learn() -> None:
    words = ("--learn", "--explore", "500", "--learn-seed", "4", "--policy", "conventional")
    agents = [understood(spec) for spec in plan("paper", "--run", "north", *words).agents(load("paper"))]
    for it in agents:
        assert (it.learn, it.explore, it.learn_seed, it.learned) == (True, 500, 4, Path("runs/north/learned"))
    assert [it.policy for it in agents] == [None, *["conventional"] * 3]
    assert not any(understood(spec).learn for spec in plan("paper").agents(load("paper")))
