"""A prosumer agent: sees its own homes, commands their batteries."""

from __future__ import annotations

import numpy as np

from zengrid.bus.agent import AgentLink
from zengrid.core.params import Homes
from zengrid.errors import PolicyError, ZengridError
from zengrid.policy import ProsumerPolicy, ProsumerView
from zengrid.wire.requests import HomeLimits, JoinReply, JoinRequest, PolicyReply, PolicyRequest
from zengrid.wire.slots import FleetAction, FleetObservation
from zengrid_agent.session import AgentSession


class Prosumer(AgentSession[FleetObservation]):
    """Plays one agent's homes with a policy that is made when the market is known."""

    observation = FleetObservation

    def __init__(self, link: AgentLink, wish: JoinRequest, policy: PolicyMaker) -> None:
        super().__init__(link, wish)
        self._make = policy

    def welcome(self, market: JoinReply) -> None:
        """Make the policy for these homes."""
        self._market = market
        self._homes = homes_of(market.homes)
        self._policy = self._make(market, self._homes)

    def act(self, seen: FleetObservation) -> FleetAction:
        """Command every battery."""
        view = ProsumerView(
            day=seen.day,
            slot=seen.slot,
            dt_h=self._market.dt_h,
            soc=seen.soc,
            pv_kw=seen.pv_kw,
            load_kw=seen.load_kw,
            buy_price=seen.buy_price,
            sell_price=seen.sell_price,
            homes=self._homes,
        )
        return FleetAction.trusted(
            v=1,
            run=seen.run,
            day=seen.day,
            slot=seen.slot,
            phase="battery",
            instance=self.wish.instance,
            battery_kw=self._policy.act(view),
        )
