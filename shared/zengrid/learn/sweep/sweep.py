"""A sweep in a folder: what is left to do, what is done, and all of it as one tidy table."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from zengrid.errors import PolicyError
from zengrid.learn.sweep.cell import Cell, Market, batches
from zengrid.learn.sweep.job import KEYS, RESULT, Job, leader_job, leader_key, training_job
from zengrid.learn.sweep.table import rows

if TYPE_CHECKING:
    import pandas as pd

JOBS = "jobs"


class Done(NamedTuple):
    """A market that was trained and judged."""

    market: Market
    evaluation: dict[str, Any]
    """as ``Evaluation.as_dict`` gives it"""
    leader: dict[str, Any] | None
    """schedule ``buy_price`` and ``outcome`` of the leader reference, where one was asked for and exists"""
    folder: Path
    """of its training"""
    place: int
    """among the markets of that training"""
    policies: dict[str, str]
    """names of its policy files in there"""


class Sweep:
    """Cells times seeds.

    What is finished stays in the folder under a key of everything that decided it, and is used again by any sweep in
    this folder that asks for it: one that was stopped goes on, and one with more values or seeds trains what is new.

    Parameters
    ----------
    folder:
        Where everything is.
    cells, seeds:
        What is trained.
    days:
        Held-out days by which markets are judged.
    every:
        Days of training between evaluations.
    leader:
        Whether to search for the leader reference of every scenario, too.
    command:
        By which it can be repeated; policy files tell it.
    name:
        What trainings are called in messages.
    """

    def __init__(
        self, folder: Path, cells: Sequence[Cell], seeds: Sequence[int], days: int = 64, every: int = 20,
        leader: bool = False, command: str = "", name: str = "training",
    ) -> None:  # fmt: skip
        self.folder, self.cells, self.every, self.leader, self.command = folder, cells, every, leader, command
        self.markets = [Market(cell, seed, days) for cell in cells for seed in seeds]
        self.name = name
        self._keys = {market: market.key for market in self.markets}

    def jobs(self) -> list[Job]:
        """What is left to do. Trainings that were begun come first, as they were begun."""
        done = _results(self.folder)
        left = {key: market for market, key in self._keys.items() if key not in done}
        begun = []
        for path in sorted((self.folder / JOBS).glob(f"*/{KEYS}")):
            keys = json.loads(path.read_text(encoding="utf-8"))
            if all(key in left for key in keys):
                begun.append([left.pop(key) for key in keys])
        made = [*begun, *batches(list(left.values()))]
        jobs = [training_job(batch, self._title(batch), self.every, self.command) for batch in made]
        if self.leader:
            jobs += self._leaders()
        return jobs

    def _title(self, batch: Sequence[Market]) -> str:
        columns = {axis: [m.cell.values[axis] for m in batch] for axis in batch[0].cell.values}
        columns["seed"] = [market.seed for market in batch]
        told = [f"{axis.rpartition('.')[2]} {_some(values)}" for axis, values in columns.items()]
        return f"{self.name}: {'; '.join(told)}"

    def _leaders(self) -> list[Job]:
        """One for each scenario, where stored energy starts anew each day: else there is no single day to search."""
        wanted = {leader_key(m): m for m in self.markets if m.cell.scenario.soc_reset == "daily"}
        jobs = [leader_job(market, f"leader reference{_told(market.cell)}") for market in wanted.values()]
        return [job for job in jobs if not (self.folder / JOBS / job.id / RESULT).exists()]

    def done(self) -> list[Done]:
        """All markets that are finished, in the order of cells and seeds."""
        results, found = _results(self.folder), []
        leaders = {}
        for market, key in self._keys.items():
            if key not in results:
                continue
            folder, entry = results[key]
            of = leader_key(market)
            if of not in leaders:
                path = self.folder / JOBS / f"leader-{of}" / RESULT
                there = self.leader and path.exists()
                leaders[of] = json.loads(path.read_text(encoding="utf-8"))["leader"] if there else None
            found.append(Done(market, entry["evaluation"], leaders[of], folder, entry["place"], entry["policies"]))
        return found

    def table(self) -> pd.DataFrame:
        """One row for each cell, seed, agent and figure; see ``zengrid.learn.sweep.table``."""
        import pandas as pd

        return pd.DataFrame([row for done in self.done() for row in rows(done)])

    @property
    def cpu_s(self) -> float:
        """Processor time of all that is finished. [s]"""
        paths = {done.folder / RESULT for done in self.done()}
        if self.leader:
            paths |= {self.folder / JOBS / f"leader-{leader_key(market)}" / RESULT for market in self.markets}
        return sum(json.loads(path.read_text(encoding="utf-8"))["cpu_s"] for path in paths if path.exists())


def _some(values: Sequence[Any]) -> str:
    """The different ones, or the first and the last of many."""
    different = list(dict.fromkeys(map(str, values)))
    return ", ".join(different) if len(different) < 5 else f"{different[0]} … {different[-1]}"


def _told(cell: Cell) -> str:
    told = ", ".join(f"{axis.rpartition('.')[2]} {value}" for axis, value in cell.values.items())
    return f" ({told})" if told else ""


def _results(folder: Path) -> dict[str, tuple[Path, dict[str, Any]]]:
    """Folder of its training and what it came to, for every market that is finished in a folder."""
    found = {}
    for path in sorted((folder / JOBS).glob(f"train-*/{RESULT}")):
        for market in json.loads(path.read_text(encoding="utf-8"))["markets"]:
            found[market["key"]] = path.parent, market
    return found


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Keep others out of a folder while it is worked in.

    Raises
    ------
    PolicyError
        Where somebody is in it already, or it cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("w")
    except OSError as error:
        raise PolicyError(f"folder {folder}: cannot be written to ({error.strerror})") from None
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PolicyError(f"folder {folder}: another process works in it; permitted: one at a time") from None
        yield
