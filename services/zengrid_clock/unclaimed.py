"""Chooses an agent for a process that takes any unclaimed home: its former one, one of the scenario, or its own."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import TYPE_CHECKING

from zengrid.errors import WireError
from zengrid_clock.agent_registry import MarketAgent

if TYPE_CHECKING:
    from zengrid.wire.queries import JoinRequest

READY_S = 10.0
"""A process that has joined keeps its agent for this long before its liveliness token must appear. [s]"""


def choose_unclaimed(request: JoinRequest, agents: list[MarketAgent], homes: Iterable[str]) -> JoinRequest:
    """Turn a request for any unclaimed agent into one for a certain agent.

    A process that begins its ``instance`` with its name and a dot is recognised after a restart, also by a clock that
    was restarted, and gets back the agent that it played.

    Parameters
    ----------
    agents:
        All prosumer agents, those that are about to join included.
    homes:
        Ids of the homes in the market.

    Raises
    ------
    WireError
        If the process brings more than one home.
    """
    own_homes = request.homes or ()
    if len(own_homes) > 1:
        raise WireError(f"homes = {len(own_homes)} homes: one at most when an unclaimed agent is asked for")
    for agent in agents:
        if agent.instance == request.instance:  # It asks again because it missed the reply.
            return _as(request, agent)
    free = [agent for agent in agents if _is_unclaimed(agent)]
    own_name = f"{request.agent}."
    former = [agent for agent in free if agent.instance is not None and agent.instance.startswith(own_name)]
    of_scenario = [agent for agent in free if not agent.brought_homes]
    # Agents that were never played come before those whose process may return.
    of_scenario.sort(key=lambda agent: agent.instance is not None)
    for agent in (*former, *of_scenario):
        return _as(request, agent)
    if not own_homes:
        return request.model_copy(update={"unclaimed": False})
    taken = {agent.id for agent in agents} | set(homes)
    names = (request.agent, *(f"{request.agent}-{i}" for i in range(2, len(taken) + 3)))
    name = next(name for name in names if name not in taken)
    own = own_homes[0].model_copy(update={"id": name})
    return request.model_copy(update={"agent": name, "homes": (own,), "unclaimed": False})


def _is_unclaimed(agent: MarketAgent) -> bool:
    return not agent.has_token and time.monotonic() - agent.joined_at > READY_S


def _as(request: JoinRequest, agent: MarketAgent) -> JoinRequest:
    return request.model_copy(update={"agent": agent.id, "homes": None, "unclaimed": False})
