"""A training with a folder: evaluated as it goes, the best policies kept, stopped and resumed at any day."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
import torch
from pydantic import Field, ValidationError
from pydantic_core import from_json

from zengrid import __version__
from zengrid.core.observe import ObservationKind
from zengrid.errors import PolicyError
from zengrid.learn.checkpoint import Count, State, Values, read_tensors, read_values, save
from zengrid.learn.evaluation import Changes, Evaluator, Outcome, Rank, Trained, plain
from zengrid.learn.settings import Settings
from zengrid.learn.training import Earned, Progress, Training, training_shapes
from zengrid.policy.tensor_file import TensorFile, naming
from zengrid.scenario import Scenario, dumps
from zengrid.scenario.files import loads
from zengrid.validation import first_error

CHECKPOINT = "training.checkpoint"
FORMAT = f"zengrid.training/{__version__}"
PROGRESS = "progress.jsonl"
SCENARIO = "scenario.yaml"
CHOICE_DAYS = 64


class Plan(NamedTuple):
    """What is trained, as it stands in the folder."""

    scenarios: tuple[Scenario, ...]
    """one for each market"""
    seeds: tuple[int, ...]
    """one for each market"""
    settings: Settings
    observation: ObservationKind
    command: str
    """by which it can be repeated"""

    def as_dict(self) -> dict[str, Any]:
        """Plain values; markets that share a scenario share its text."""
        texts = list(dict.fromkeys(dumps(scenario) for scenario in self.scenarios))
        return {
            "scenarios": texts,
            "scenario_of": [texts.index(dumps(scenario)) for scenario in self.scenarios],
            "seeds": list(self.seeds),
            "settings": self.settings.as_dict(),
            "observation": self.observation,
            "command": self.command,
        }

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Read what ``as_dict`` wrote.

        Raises
        ------
        ZengridError
            Where it is no plan.
        """
        try:
            written = _Plan.model_validate_json(json.dumps(values))
        except ValidationError as error:
            raise PolicyError(f"plan.{first_error(error)}") from None
        count = len(written.scenarios)
        if len(written.scenario_of) != len(written.seeds) or max(written.scenario_of) >= count:
            raise PolicyError(f"plan.scenario_of: permitted is one of {count} scenarios for each of the seeds")
        made = [loads(text) for text in written.scenarios]
        scenarios = tuple(made[i] for i in written.scenario_of)
        settings = Settings.of(written.settings)
        return cls(scenarios, tuple(written.seeds), settings, written.observation, written.command)


class _Plan(Values):
    """A plan as it is written down."""

    scenarios: list[str]
    """Different ones, as YAML."""
    scenario_of: Annotated[list[Count], Field(min_length=1)]
    """The place of the scenario of each market among them."""
    seeds: list[Count]
    settings: dict[str, Any]
    observation: ObservationKind
    command: str


class _Kept(Values):
    """What ``Kept`` holds, as it is written down."""

    bill: list[float]
    profit: float
    reserve: float
    gap: float | None
    settled: bool
    gain: float


class _Earned(Values):
    """What ``Earned`` holds, as it is written down."""

    bill: list[list[float]]
    profit: list[float]
    reserve_kwh: list[float]


class _Written(Values):
    """What the checkpoint holds beside its arrays."""

    plan: dict[str, Any]
    training: Progress
    seconds: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    earned: list[_Earned]
    best: list[_Kept | None]


class Report(NamedTuple):
    """How the training stands after an evaluation."""

    step: int
    steps: int
    seconds: float
    """trained so far, evaluations left out [s]"""
    agent_steps: int
    """decisions taken by all agents so far"""
    now: list[Changes]
    """of each market, as it is [%]"""
    best: list[Changes]
    """of each market, as it was at its best [%]"""
    agents: list[Outcome]
    """of each market, as it is, on the days for the choice"""
    earned: list[Earned]
    """of each day of training since the last report"""
    gap: list[float | None]
    """largest gap of a prosumer of each market, as it is; None where it takes too long to compute [%]"""
    best_gap: list[float | None]
    """the same of the policies kept [%]"""


class Kept(NamedTuple):
    """What the policies kept of a market came to, on the days for the choice."""

    changes: Changes
    gap: float | None
    """largest gap of a prosumer [%]"""
    rank: Rank
    """by which they were chosen"""

    @property
    def joint_gain(self) -> float:
        """See ``Changes.joint_gain``. [%]"""
        return self.changes.joint_gain


class Run:
    """A training in a folder.

    The policies kept as ``best-*`` are those with the highest rank (``Evaluation.rank``) on days set apart for
    this choice; ``last-*`` are the newest.

    Parameters
    ----------
    folder:
        Where everything is written.
    plan:
        What to train.
    device:
        Where the networks are.
    """

    def __init__(self, folder: Path, plan: Plan, device: str = "cpu") -> None:
        self.folder, self.plan = folder, plan
        self.training = Training(plan.scenarios, plan.seeds, plan.settings, plan.observation, device)
        made = {id(s): Evaluator.for_choice(s, plan.settings.pool, CHOICE_DAYS) for s in plan.scenarios}
        self.choosers = [made[id(scenario)] for scenario in plan.scenarios]
        self.seconds = 0.0
        self._earned: list[Earned] = []
        self.best: list[Kept | None] = [None] * len(plan.seeds)

    @classmethod
    def resume(cls, folder: Path, device: str = "cpu") -> Self:
        """Go on where a training was stopped.

        Raises
        ------
        PolicyError
            Where the folder holds none, or one of another version, or one that no training can have left. Nothing in
            it is ever run, and the folder stays as it is.
        """
        path = folder / CHECKPOINT
        with naming("checkpoint", path), TensorFile(path) as file:
            written = read_values(file, FORMAT, _Written)
            plan = Plan.of(written.plan)
            # Before anything is made of the plan, which can ask for more memory than there is.
            wanted = training_shapes(plan.scenarios, plan.settings, plan.observation, torch.device(device))
            tensors = read_tensors(file, wanted)
            run = cls(folder, plan, device)
            run.training.restore(State(written.training, tensors))
            run._remember(written)
            run.forget_later()
        return run

    def _remember(self, written: _Written) -> None:
        """Take over what was reached so far."""
        markets, homes = len(self.plan.seeds), len(self.plan.scenarios[0].homes)
        if len(written.best) != markets or any(kept and len(kept.bill) != homes for kept in written.best):
            raise PolicyError(f"best: permitted are {markets} markets of {homes} homes")
        for day in written.earned:
            if [len(day.profit), len(day.reserve_kwh), *map(len, day.bill)] != [markets, markets, *[homes] * markets]:
                raise PolicyError(f"earned: permitted are days of {markets} markets of {homes} homes")
        self.seconds = written.seconds
        self._earned = [
            Earned(np.array(day.bill), np.array(day.profit), np.array(day.reserve_kwh)) for day in written.earned
        ]
        self.best = [
            None
            if it is None
            else Kept(Changes(np.array(it.bill), it.profit, it.reserve), it.gap, Rank(it.settled, it.gain))
            for it in written.best
        ]

    def go(
        self,
        report: Callable[[Report], None],
        stop: Callable[[], bool] = lambda: False,
        every: int = 5,
        most_seconds: float | None = None,
        judge_stop: bool = True,
    ) -> bool:
        """Train to the end, or until asked to stop; returns whether the end was reached.

        Parameters
        ----------
        report:
            Told of every evaluation.
        stop:
            Asked after each day.
        every:
            Days between evaluations.
        most_seconds:
            Time to train in all, what was before a resumption included. [s]
        judge_stop:
            Whether to evaluate where it is stopped, too, so that there are policies to use. Without, the best policies
            of a training that was stopped and resumed are those of one that was not.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / SCENARIO).write_text(dumps(self.plan.scenarios[0]), encoding="utf-8")
        training, day = self.training, self.training.step // self.plan.scenarios[0].slots_per_day
        ends = training.done
        while not ends:
            start = time.perf_counter()
            self._earned.append(training.day())
            self.seconds += time.perf_counter() - start
            day += 1
            late = most_seconds is not None and self.seconds >= most_seconds
            ends = training.done or late or stop()
            due = day % every == 0 or training.done
            if due or (ends and judge_stop):
                report(self.evaluate())
            if due or ends:
                self.save()
        return training.done

    def evaluate(self) -> Report:
        """How all markets fare; keeps the best policies."""
        now, agents, gaps = [], [], []
        for place, trained in enumerate(self.training.trained(notes=self.notes())):
            evaluation = self.choosers[place].evaluate_trained(trained, gaps=False)
            this = Kept(evaluation.changes, evaluation.largest_gap, evaluation.rank)
            known = self.best[place]
            if known is None or this.rank > known.rank:
                self.best[place] = this
                self._write("best", place, trained)
            self._write("last", place, trained)
            now.append(this.changes)
            gaps.append(this.gap)
            agents.append(evaluation.agents)
        training = self.training
        deciding = sum(1 + len(scenario.homes) for scenario in self.plan.scenarios)
        best = [kept for kept in self.best if kept is not None]
        report = Report(
            training.step, training.settings.steps, self.seconds, training.step * training.settings.days * deciding,
            now, [kept.changes for kept in best], agents, self._earned, gaps, [kept.gap for kept in best],
        )  # fmt: skip
        self._earned = []
        lists = {name: [plain(one) for one in getattr(report, name)] for name in ("now", "best", "agents", "earned")}
        with (self.folder / PROGRESS).open("a", encoding="utf-8") as file:
            file.write(json.dumps({**report._asdict(), **lists}) + "\n")
        return report

    @property
    def highest(self) -> int:
        """The place of the market whose policies rank highest, once there are any.

        Markets have several equilibria, and a single learner seldom leaves the one it has come to. Of several seeds
        that one is best to play with.
        """
        # An evaluation ranks all markets, so that none is left out here.
        ranks = [kept.rank for kept in self.best if kept is not None]
        return ranks.index(max(ranks))

    def forget_later(self) -> None:
        """Take out of the progress what came after the checkpoint: it comes again, and alike."""
        path = self.folder / PROGRESS
        if path.exists():
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            # A line without an end was being written when the machine stopped.
            whole = [line for line in lines if line.endswith("\n")]
            try:
                kept = [line for line in whole if int(from_json(line)["step"]) <= self.training.step]
            except (ValueError, TypeError, KeyError) as error:
                raise PolicyError(f"{path.name} beside it has a line that is no evaluation ({error})") from None
            path.write_text("".join(kept), encoding="utf-8")

    def notes(self) -> dict[str, Any]:
        """What policy files tell about how they were made."""
        return {"command": self.plan.command, "version": __version__, "seconds": round(self.seconds, 1)}

    def names(self, place: int) -> str:
        """What the files of a market are called after."""
        several = len({dumps(scenario) for scenario in self.plan.scenarios}) > 1
        return f"seed{self.plan.seeds[place]}" + (f"-{place}" if several else "")

    def _write(self, kind: str, place: int, trained: Trained) -> None:
        for part, file in trained._asdict().items():
            file.save(self.folder / f"{kind}-{self.names(place)}-{part}.safetensors")

    def save(self) -> None:
        """Write the checkpoint; an interruption leaves the one before."""
        progress, tensors = self.training.state()
        written = _Written(
            plan=self.plan.as_dict(),
            training=progress,
            seconds=self.seconds,
            earned=[_Earned(**plain(day)) for day in self._earned],
            best=[kept and _Kept(**plain(kept.changes), gap=kept.gap, **kept.rank._asdict()) for kept in self.best],
        )
        save(self.folder / CHECKPOINT, FORMAT, State(written, tensors))


def use_threads(count: int) -> None:
    """How many threads networks are evaluated with. They are small: more than two seldom help."""
    torch.set_num_threads(count)
