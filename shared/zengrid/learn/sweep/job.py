"""Jobs: one batch to train and judge, or one leader reference to search for. Each has a folder and one result in it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from zengrid.learn.evaluation import Evaluator, Trained, plain
from zengrid.learn.run import CHECKPOINT, PROGRESS, Plan, Run, use_threads
from zengrid.learn.sweep.cell import Market, digest
from zengrid.policy.file import PolicyFile
from zengrid.scenario.files import loads

RESULT = "result.json"
KEYS = "markets.json"
_SPENT = "spent.json"

Report = Callable[[float], None]
"""Told how far a job is, 0 to 1."""
Stop = Callable[[], bool]
"""Asked whether to stop."""


class Job(NamedTuple):
    """Something to do, as plain values: it can be sent to another machine."""

    id: str
    """names its folder"""
    kind: Literal["train", "leader"]
    title: str
    arguments: dict[str, Any]
    effort: float
    """about how many seconds of a processor it takes"""


def training_job(markets: Sequence[Market], title: str, every: int, command: str) -> Job:
    """Train markets side by side, and judge them on held-out days."""
    first = markets[0]
    plan = Plan(
        tuple(market.cell.scenario for market in markets), tuple(market.seed for market in markets),
        first.cell.settings, first.cell.observation, command,
    )  # fmt: skip
    keys = [market.key for market in markets]
    settings = first.cell.settings
    # A rough measure is enough to show how far all jobs are.
    slots = settings.steps * settings.days * len(markets) * (1 + len(first.cell.scenario.homes))
    return Job(
        f"train-{digest(keys)}", "train", title,
        {"plan": plan.as_dict(), "keys": keys, "days": first.days, "every": every}, 6e-6 * slots,
    )  # fmt: skip


def leader_job(market: Market, title: str) -> Job:
    """Search for the price schedule that pays a grid best whose prosumers play best responses."""
    return Job(
        f"leader-{leader_key(market)}", "leader", title, {"scenario": market.cell.text, "days": market.days},
        5.0 * len(market.cell.scenario.homes),
    )  # fmt: skip


def leader_key(market: Market) -> str:
    """Names a leader reference: it depends on the scenario and its days, and on nothing learned."""
    return digest([market.cell.text, market.days])


def do(job: Job, folder: Path, report: Report, stop: Stop) -> bool:
    """Do a job in its folder, or as much of it as there is time for; returns whether it is done."""
    folder.mkdir(parents=True, exist_ok=True)
    begun = time.process_time()
    arguments = job.arguments
    result = _train(folder, report, stop, **arguments) if job.kind == "train" else _leader(**arguments)
    spent_s = _read(folder / _SPENT, 0.0) + time.process_time() - begun
    if result is None:
        write(folder / _SPENT, spent_s)
        return False
    write(folder / RESULT, {**result, "cpu_s": round(spent_s, 1)})
    for left in (CHECKPOINT, _SPENT, KEYS):
        (folder / left).unlink(missing_ok=True)
    return True


def _train(
    folder: Path, report: Report, stop: Stop, plan: dict[str, Any], keys: list[str], days: int, every: int
) -> dict[str, Any] | None:
    use_threads(1)
    write(folder / KEYS, keys)
    if (folder / CHECKPOINT).exists():
        run = Run.resume(folder)
    else:
        (folder / PROGRESS).unlink(missing_ok=True)  # of one that was killed before its first checkpoint
        run = Run(folder, Plan.of(plan))

    def ask() -> bool:
        report(run.training.progress)
        return stop()

    if not run.go(lambda _: None, ask, every, judge_stop=False):
        return None
    judges: dict[int, Evaluator] = {}
    markets = []
    for place, (scenario, key) in enumerate(zip(run.plan.scenarios, keys, strict=True)):
        if id(scenario) not in judges:
            judges[id(scenario)] = Evaluator.held_out(scenario, days)
        files = {part: f"best-{run.names(place)}-{part}.safetensors" for part in Trained._fields}
        trained = Trained(*(PolicyFile.load(folder / file) for file in files.values()))
        evaluation = judges[id(scenario)].evaluate_trained(trained)
        markets.append({"key": key, "place": place, "policies": files, "evaluation": evaluation.as_dict()})
    return {"seconds": round(run.seconds, 1), "markets": markets}


def _leader(scenario: str, days: int) -> dict[str, Any]:
    found = Evaluator.held_out(loads(scenario), days).leader()
    if found is None:
        return {"leader": None}
    return {"leader": {"buy_price": found.buy_price.tolist(), "outcome": plain(found.outcome)}}


def write(path: Path, values: Any) -> None:
    """Write JSON; an interruption leaves what was there before."""
    part = path.with_name(f".{path.name}.part")
    part.write_text(json.dumps(values, default=_number), encoding="utf-8")
    part.replace(path)


def _number(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} is no plain value")


def _read(path: Path, otherwise: Any) -> Any:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else otherwise
