"""Finds an agent for a process that plays whichever is free: its former one, a free one of the scenario, or its own."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from zengrid.errors import WireError
from zengrid_clock.roster import Agent

if TYPE_CHECKING:
    from zengrid.wire.requests import JoinRequest
    from zengrid_clock.service import Clock

READY_S = 10.0
"""How long a process that has joined may take until it shows its token; until then its agent is not free. [s]"""


def vacancy(clock: Clock, request: JoinRequest) -> JoinRequest:
    """What a process that asks for a vacancy joins as.

    A process that begins its ``instance`` with its name and a dot is known again after a restart, also by a clock that
    was restarted, and gets back what it played.

    Raises
    ------
    WireError
        Where it brings more than one home.
    """
    homes = request.homes or ()
    if len(homes) > 1:
        raise WireError(f"homes = {len(homes)} homes: one at most can be brought where any vacancy will do")
    agents = [*clock.roster.prosumers.values(), *clock.roster.joining.values()]
    for agent in agents:
        if agent.instance == request.instance:  # It asks again, since it missed the answer.
            return _as(request, agent)
    free = [agent for agent in agents if _is_free(agent)]
    mine = f"{request.agent}."
    former = [agent for agent in free if agent.instance is not None and agent.instance.startswith(mine)]
    of_scenario = [agent for agent in free if not agent.brought]
    # Who has never been played comes before those whose process may yet come back.
    of_scenario.sort(key=lambda agent: agent.instance is not None)
    for agent in (*former, *of_scenario):
        return _as(request, agent)
    if not homes:
        return request.model_copy(update={"vacancy": False})
    taken = {agent.id for agent in agents} | set(clock.market.homes)
    names = (request.agent, *(f"{request.agent}-{i}" for i in range(2, len(taken) + 3)))
    name = next(name for name in names if name not in taken)
    own = homes[0].model_copy(update={"id": name})
    return request.model_copy(update={"agent": name, "homes": (own,), "vacancy": False})


def _is_free(agent: Agent) -> bool:
    return not agent.token and time.monotonic() - agent.bound > READY_S


def _as(request: JoinRequest, agent: Agent) -> JoinRequest:
    return request.model_copy(update={"agent": agent.id, "homes": None, "vacancy": False})
