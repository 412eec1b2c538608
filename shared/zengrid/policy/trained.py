"""The trained policies that come with zengrid: which fits an agent's market, and what it plays where none does."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from zengrid.core.params import HOME_FIELDS, Homes
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.file import PolicyFile
from zengrid.policy.network import GridNetwork, ProsumerNetwork

FOLDER = Path(__file__).with_name("files")
GRID, PROSUMERS, GENERIC = "paper-grid", "paper-prosumers", "generic"
"""Names of the files: the case study's agents, and one for homes of any size."""

_BATTERY_FIELDS = tuple(name for name in HOME_FIELDS if name not in ("injection_max_kw", "soc_initial"))


class Choice(NamedTuple):
    """What ``trained`` stands for in a market."""

    file: PolicyFile | None
    """None: the rule without demand response"""
    why: str
    """what is played, and why, for people"""


def load(name: str) -> PolicyFile:
    """A policy that comes with zengrid."""
    return PolicyFile.load(FOLDER / f"{name}.safetensors")


def for_prosumer(facts: MarketFacts) -> Choice:
    """For the agent of some homes: trained on just these homes, or for homes of any size, or none.

    Where the grid agent is none that was trained, prices hardly change, and the rule is about as good as any network.
    """
    own = load(PROSUMERS)
    if facts.scenario == own.training["scenario"] and _same_homes(own, facts):
        return Choice(own, f"{own.name}: trained on these homes")
    generic = load(GENERIC)
    reason = _misfit(generic, facts) or _elsewhere(generic, facts)
    if reason is None:
        return Choice(generic, f"{generic.name}: trained on homes of many sizes")
    return Choice(None, f"conventional: no trained policy fits, {reason}")


def for_grid(facts: MarketFacts) -> Choice:
    """For the grid agent: what a price is worth depends on costs and loads, so one fits its own market alone."""
    own = load(GRID)
    reason = _elsewhere(own, facts) or _misfit(own, facts)
    if reason is None:
        return Choice(own, f"{own.name}: trained in this market")
    return Choice(None, f"fixed: no trained policy fits, {reason}")


def batteries(homes: Homes) -> list[list[float]]:
    """The fields that identify a home for which a network was trained, one row a home."""
    columns = [getattr(homes, name) for name in _BATTERY_FIELDS]
    return [[float(value) for value in row] for row in np.stack(columns, axis=-1)]


def _same_homes(file: PolicyFile, facts: MarketFacts) -> bool:
    if _misfit(file, facts) is not None:
        return False
    known = dict(zip(file.homes, file.training["batteries"], strict=True))
    return all(known.get(home) == battery for home, battery in zip(facts.home_ids, batteries(facts.homes), strict=True))


def _elsewhere(file: PolicyFile, facts: MarketFacts) -> str | None:
    """Whether the market is another than that of the training."""
    own = file.training["scenario"]
    return None if facts.scenario == own else f"scenario = {facts.scenario or 'unknown'}: it was trained in {own}"


def _misfit(file: PolicyFile, facts: MarketFacts) -> str | None:
    """Why a file cannot be used, or would be asked about prices that it never saw."""
    for feature, prices in (("buy_price", facts.buy_prices), ("sell_price", facts.sell_prices)):
        if feature in file.features:
            place = file.features.index(feature)
            middle, half = file.offset[place], 1.0 / file.scale[place]
            if min(prices) < middle - half - 1e-9 or max(prices) > middle + half + 1e-9:
                low, high = middle - half, middle + half
                return f"{feature} = {min(prices):g} to {max(prices):g}: it was trained on {low:g} to {high:g} $/kWh"
    if abs(file.dt_h - facts.dt_h) > 1e-9:
        return f"dt_h = {facts.dt_h:g}: it was trained on slots of {file.dt_h:g} h"
    try:
        if file.role == "grid":
            GridNetwork(file, facts)
        elif not file.homes:
            ProsumerNetwork(file, facts)
    except PolicyError as error:
        return str(error)
    return None
