"""What a reproduction trains: the case study with every seed, and the same with every battery of one size."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from zengrid.core.observe import ObservationKind
from zengrid.errors import PolicyError
from zengrid.learn.settings import Settings
from zengrid.learn.sweep.cell import Cell
from zengrid.learn.sweep.job import Job
from zengrid.learn.sweep.sweep import Sweep
from zengrid.scenario import Scenario, load

CAPACITIES_KWH = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0)
CAPACITY = "capacity_kwh"
EVERY = 5
"""Days of training between two points of the curves over training."""


class Study:
    """Two sweeps in one folder.

    Parameters
    ----------
    folder:
        Where everything is.
    seeds:
        Each trains every market.
    capacities_kwh:
        Battery sizes, increasing. [kWh]
    settings, observation:
        How agents learn, and what they see.
    days:
        Held-out days.
    command:
        By which it can be repeated.
    """

    def __init__(
        self, folder: Path, seeds: Sequence[int], capacities_kwh: Sequence[float], settings: Settings,
        observation: ObservationKind, days: int, command: str,
    ) -> None:  # fmt: skip
        if not capacities_kwh or list(capacities_kwh) != sorted(set(capacities_kwh)) or capacities_kwh[0] <= 0:
            told = ", ".join(f"{size:g}" for size in capacities_kwh)
            raise PolicyError(f"capacities = {told}: permitted: increasing sizes above 0 kWh")
        self.folder, self.seeds, self.capacities_kwh, self.command = folder, tuple(seeds), capacities_kwh, command
        self.scenario, self.settings, self.observation, self.days = load("paper"), settings, observation, days
        cells = [
            Cell({CAPACITY: size}, with_capacity(self.scenario, size), settings, observation) for size in capacities_kwh
        ]
        own = [Cell({}, self.scenario, settings, observation)]
        self.paper = Sweep(folder, own, seeds, days, EVERY, True, command, "the case study")
        self.capacity = Sweep(folder, cells, seeds, days, leader=True, command=command, name="every battery of")

    def jobs(self) -> list[Job]:
        """What is left to do, longest first: trainings, then leader references."""
        jobs = {job.id: job for job in chain(self.paper.jobs(), self.capacity.jobs())}
        return sorted(jobs.values(), key=lambda job: job.kind == "leader")


def with_capacity(scenario: Scenario, size_kwh: float) -> Scenario:
    """Every battery of one size, with the usable energy (beyond ``soc_min``) with which it begins the day in the paper.

    What a battery holds in the morning is a gift of each day. If it grew with the size, or shrank as ``soc_min`` locks
    more of it away, that would be taken for a use of the size, or hide it.
    """
    changes: dict[str, float] = {}
    for place, home in enumerate(scenario.homes):
        battery = home.battery
        usable_kwh = (battery.soc_initial - battery.soc_min) * battery.capacity_kwh
        low_kwh, high_kwh = battery.soc_min * size_kwh, battery.soc_max * size_kwh
        path = f"homes.{place}.battery"
        changes[f"{path}.capacity_kwh"] = size_kwh
        changes[f"{path}.initial_kwh"] = min(low_kwh + usable_kwh, high_kwh)
    return scenario.with_(**changes)
