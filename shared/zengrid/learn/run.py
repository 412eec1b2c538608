"""A training with a folder: evaluated as it goes, the best policies kept, stopped and resumed at any day."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Self

import torch

from zengrid import __version__
from zengrid.core.observe import ObservationKind
from zengrid.errors import PolicyError
from zengrid.learn.evaluation import Changes, Evaluator, Outcome, Rank, Trained, plain
from zengrid.learn.settings import Settings
from zengrid.learn.training import Earned, Training
from zengrid.scenario import Scenario
from zengrid.scenario.files import loads

CHECKPOINT = "checkpoint.pt"
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
        texts = list(dict.fromkeys(scenario.dump() for scenario in self.scenarios))
        return {
            "scenarios": texts,
            "scenario_of": [texts.index(scenario.dump()) for scenario in self.scenarios],
            "seeds": list(self.seeds),
            "settings": self.settings.as_dict(),
            "observation": self.observation,
            "command": self.command,
            "version": __version__,
        }

    @classmethod
    def of(cls, values: dict[str, Any]) -> Self:
        """Read what ``as_dict`` wrote."""
        made = [loads(text) for text in values["scenarios"]]
        return cls(
            tuple(made[i] for i in values["scenario_of"]),
            tuple(values["seeds"]),
            Settings.of(values["settings"]),
            values["observation"],
            values["command"],
        )


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
        folder.mkdir(parents=True, exist_ok=True)
        (folder / SCENARIO).write_text(plan.scenarios[0].dump(), encoding="utf-8")

    @classmethod
    def resume(cls, folder: Path, device: str = "cpu") -> Self:
        """Go on where a training was stopped.

        Raises
        ------
        PolicyError
            Where the folder holds none, or one of another version.
        """
        path = folder / CHECKPOINT
        try:
            saved = torch.load(path, map_location=device, weights_only=False)
        except (OSError, RuntimeError) as error:
            raise PolicyError(f"checkpoint {path}: cannot be read ({error})") from None
        if saved["plan"]["version"] != __version__:
            raise PolicyError(f"checkpoint {path}: of version {saved['plan']['version']}; permitted: {__version__}")
        run = cls(folder, Plan.of(saved["plan"]), device)
        run.training.restore(saved["training"])
        run.seconds = saved["seconds"]
        run._earned = [Earned(*day) for day in saved["earned"]]
        run.forget_later()
        run.best = [
            None if kept is None else Kept(Changes(*kept[0]), kept[1], Rank(*kept[2])) for kept in saved["best"]
        ]
        return run

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
            whole = (line for line in lines if line.endswith("\n"))
            path.write_text("".join(line for line in whole if json.loads(line)["step"] <= self.training.step))

    def notes(self) -> dict[str, Any]:
        """What policy files tell about how they were made."""
        return {"command": self.plan.command, "version": __version__, "seconds": round(self.seconds, 1)}

    def names(self, place: int) -> str:
        """What the files of a market are called after."""
        several = len({scenario.dump() for scenario in self.plan.scenarios}) > 1
        return f"seed{self.plan.seeds[place]}" + (f"-{place}" if several else "")

    def _write(self, kind: str, place: int, trained: Trained) -> None:
        for part, file in trained._asdict().items():
            file.save(self.folder / f"{kind}-{self.names(place)}-{part}.safetensors")

    def save(self) -> None:
        """Write the checkpoint; an interruption leaves the one before."""
        saved = {
            "plan": self.plan.as_dict(),
            "training": self.training.state(),
            "seconds": self.seconds,
            "earned": [tuple(day) for day in self._earned],
            "best": [None if kept is None else (tuple(kept.changes), kept.gap, tuple(kept.rank)) for kept in self.best],
        }
        part = self.folder / f"{CHECKPOINT}.part"
        torch.save(saved, part)
        part.replace(self.folder / CHECKPOINT)


def use_threads(count: int) -> None:
    """How many threads networks are evaluated with. They are small: more than two seldom help."""
    torch.set_num_threads(count)
