"""A market in which the test itself acts for one home."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from zengrid.bus.agent_link import AgentLink
from zengrid.testing import RunningMarket
from zengrid.wire.codec import JSON, encode
from zengrid.wire.queries import JoinRequest
from zengrid.wire.slots import FleetAction

INSTANCE = "fedcba9876543210"


class ManualAgent:
    """Receives the observations of p1, and sends its actions."""

    def __init__(self, market: RunningMarket, link: AgentLink) -> None:
        self._run = market.run
        self._link = link

    def wait_for_observation(self) -> None:
        """Wait for the next observation."""
        assert self._link.receive() is not None

    def command(self, slot: int, kw: float | list[float]) -> None:
        """Command the battery in a slot of day 0."""
        battery_kw = np.atleast_1d(np.array(kw, dtype=float))
        action = FleetAction(run=self._run, day=0, slot=slot, instance=INSTANCE, battery_kw=battery_kw)
        self._link.act(encode(action), JSON)


@contextmanager
def playing_p1(market: RunningMarket) -> Iterator[ManualAgent]:
    """Start processes for all agents of a paused market but p1, and wait until all are ready."""
    market.start_agents("p2", "p3")
    with AgentLink("p1", market.run, market.endpoint) as link:
        link.join(JoinRequest(agent="p1", role="prosumer", instance=INSTANCE))
        link.ready()
        market.wait_for_status(lambda status: status.state == "paused", missing="the market ready")
        yield ManualAgent(market, link)
