"""The grid agent: sees the costs of the last slot, sets the price at which the grid buys."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zengrid.bus.agent import AgentLink
from zengrid.policy import GridPolicy, GridView
from zengrid.wire.requests import JoinReply, JoinRequest, PolicyReply, PolicyRequest
from zengrid.wire.slots import GridAction, GridObservation
from zengrid_agent.answers import explain_policy
from zengrid_agent.session import AgentSession


class Grid(AgentSession[GridObservation]):
    """Sets prices with a policy that is made when the market is known."""

    observation = GridObservation

    def __init__(self, link: AgentLink, wish: JoinRequest, make: Callable[[JoinReply], GridPolicy]) -> None:
        super().__init__(link, wish)
        self._make = make

    def welcome(self, market: JoinReply) -> None:
        """Make the policy for this market."""
        self._dt_h = market.dt_h
        self._levels = np.array(market.buy_prices)
        self._policy = self._make(market)

    def act(self, seen: GridObservation) -> GridAction:
        """Set the price."""
        view = GridView(
            day=seen.day,
            slot=seen.slot,
            dt_h=self._dt_h,
            facility_cost=seen.facility_cost,
            payment=seen.payment,
            payment_sum=seen.payment_sum,
            homes=seen.homes,
            demand_kw=seen.demand_kw,
            sell_price=seen.sell_price,
            buy_prices=self._levels,
        )
        return GridAction.trusted(
            v=1,
            run=seen.run,
            day=seen.day,
            slot=seen.slot,
            phase="price",
            instance=self.wish.instance,
            buy_price=float(self._policy.act(view)),
        )

    def answer(self, wish: PolicyRequest) -> PolicyReply:
        """What it would do."""
        return explain_policy("grid", self._policy, wish)
