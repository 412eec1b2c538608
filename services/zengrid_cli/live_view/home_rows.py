"""Rows of the live view: one for each home, or one for each agent if there are too many homes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zengrid.wire.queries import AgentStatus, HomesStatus, Status

Presence = Literal["present", "absent", "away"]


@dataclass(frozen=True, slots=True)
class HomeRow:
    """One home, or the sum over the homes of one agent."""

    name: str
    homes: int
    soc: float | None
    """Stored energy as part of the capacity; None without a battery [-]"""
    battery_kw: float
    pv_kw: float
    load_kw: float
    bill: float
    """[$]"""
    baseline_bill: float
    """[$]"""
    presence: Presence
    policy: str
    fallbacks: int


def home_rows(status: Status, homes: HomesStatus, limit: int) -> tuple[list[HomeRow], HomeRow]:
    """The rows to show, and the sum over all homes.

    Homes have a row each if they fit. Otherwise agents have; if there are more agents than fit, those that are not
    present come first, then those that save most.
    """
    agents = {agent.id: agent for agent in status.agents}
    index = np.arange(len(homes.homes))
    total = replace(_row("all", index, homes, None), presence="present")
    if len(homes.homes) <= limit:
        return [_row(homes.homes[i], index[i : i + 1], homes, agents.get(homes.agents[i])) for i in index], total
    members: dict[str, list[int]] = {}
    for i, agent in enumerate(homes.agents):
        members.setdefault(agent, []).append(i)
    listed = [_row(name, np.array(mine), homes, agents.get(name)) for name, mine in members.items()]
    if len(listed) > limit:
        listed.sort(key=lambda row: (row.presence == "present", row.bill - row.baseline_bill))
    return listed[: max(limit, 0)], total


def _row(name: str, mine: NDArray[np.int64], homes: HomesStatus, agent: AgentStatus | None) -> HomeRow:
    def total(column: NDArray[np.float64]) -> float:
        return float(column[mine].sum())

    capacity = total(homes.capacity_kwh)
    stored = float((homes.soc[mine] * homes.capacity_kwh[mine]).sum())
    return HomeRow(
        name=name,
        homes=len(mine),
        soc=stored / capacity if capacity > 0 else None,
        battery_kw=total(homes.battery_kw),
        pv_kw=total(homes.pv_kw),
        load_kw=total(homes.load_kw),
        bill=total(homes.bill),
        baseline_bill=total(homes.baseline_bill),
        presence="away" if agent is None else agent.presence,
        policy="" if agent is None else agent.policy,
        fallbacks=0 if agent is None else agent.fallbacks,
    )
