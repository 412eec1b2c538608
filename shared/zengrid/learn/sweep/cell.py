"""Cells of a sweep, and which of their markets are trained in one batch."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from hashlib import sha256
from itertools import pairwise
from typing import Any, NamedTuple

from zengrid import __version__
from zengrid.core.observe import ObservationKind
from zengrid.learn.settings import Settings
from zengrid.scenario import Scenario, dumps

MOST_MARKETS = 10
"""Trained in one batch. More would hardly be faster, and could not be shared among processes."""

_ALIKE = ("slot_minutes", "tariff", "buy_prices", "battery_levels", "soc_reset", "value_of_lost_load", "facilities")


class Cell:
    """One combination of values: what is trained, with every seed.

    Parameters
    ----------
    values:
        What distinguishes it, by axis: columns of the table.
    scenario, settings, observation:
        What that comes to.
    """

    def __init__(
        self, values: Mapping[str, Any], scenario: Scenario, settings: Settings, observation: ObservationKind = "public"
    ) -> None:
        self.values, self.scenario, self.settings, self.observation = values, scenario, settings, observation

    @cached_property
    def text(self) -> str:
        """The complete scenario."""
        return dumps(self.scenario)

    @cached_property
    def shape(self) -> str:
        """The same for cells that can be trained in one batch."""
        fields = self.scenario.model_dump(mode="json", include=set(_ALIKE))
        counts = [len(self.scenario.homes), len(self.scenario.consumers)]
        return json.dumps([fields, counts, self.settings.as_dict(), self.observation], sort_keys=True)


class Market(NamedTuple):
    """One cell with one seed."""

    cell: Cell
    seed: int
    days: int
    """held-out days it is judged by"""

    @property
    def key(self) -> str:
        """Names its result: the same for everything that decides it, but for the company it is trained in."""
        cell = self.cell
        return digest([cell.text, cell.settings.as_dict(), cell.observation, self.seed, self.days])


def digest(values: Any) -> str:
    """A short name for plain values and the version of zengrid."""
    return sha256(json.dumps([values, __version__], sort_keys=True).encode()).hexdigest()[:16]


def batches(markets: Sequence[Market], most: int = MOST_MARKETS) -> list[list[Market]]:
    """Markets that are trained together: those of one shape, in parts of nearly equal size.

    Nothing else than the markets decides it, so that the same sweep gives the same results on any number of processes.
    """
    groups: dict[str, list[Market]] = {}
    for market in markets:
        groups.setdefault(market.cell.shape, []).append(market)
    made = []
    for group in groups.values():
        parts = -(-len(group) // most)
        edges = [len(group) * i // parts for i in range(parts + 1)]
        made += [group[a:b] for a, b in pairwise(edges)]
    return made
