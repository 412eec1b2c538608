"""The grid agent: sees the costs of the last slot, sets the price at which the grid buys."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from zengrid.bus.agent_link import AgentLink
from zengrid.core.observe import grid_features
from zengrid.policy import trained
from zengrid.policy.facts import MarketFacts
from zengrid.policy.network import GridNetwork
from zengrid.policy.registry import make_grid_policy
from zengrid.policy.views import GridView
from zengrid.wire.queries import JoinReply, JoinRequest, PolicyReply, PolicyRequest
from zengrid.wire.slot_structs import GridObservationStruct
from zengrid_agent.answers import policy_reply, slot_of
from zengrid_agent.facts import market_facts
from zengrid_agent.learning import Learning
from zengrid_agent.session import AgentSession, new_instance


class Grid(AgentSession[GridObservationStruct]):
    """Sets prices with a policy that is made when the market is known."""

    observation = GridObservationStruct

    def __init__(self, link: AgentLink, request: JoinRequest, learning: Learning | None = None) -> None:
        super().__init__(link, request, learning)
        self._facts: MarketFacts | None = None

    def welcome(self, market: JoinReply) -> None:
        """Make the policy for this market."""
        if self._facts is None:
            self._facts = market_facts(market, ())
            self._levels = np.array(market.buy_prices)
            self._policy = make_grid_policy(self.request.policy, self._facts)
            if self._learning is not None:
                self.say(self._learning.begin(self._facts, self.request.policy))
            elif self.request.policy == "trained":
                self.say(f"grid plays {trained.for_grid(self._facts).why}")

    def act(self, seen: GridObservationStruct) -> dict[str, Any]:
        """Set the price."""
        assert self._facts is not None
        view = GridView(
            seen.day,
            seen.slot,
            self._facts.dt_h,
            np.asarray(seen.facility_cost),
            None if seen.payment is None else np.asarray(seen.payment),
            seen.payments,
            seen.homes,
            seen.demand_kw,
            seen.sell_price,
            self._levels,
        )
        price = None
        if self._learning is not None:
            learner = self._learning.grid
            if seen.settled is not None:
                last = seen.settled
                learner.hear(last.day, last.slot, last.reward, last.buy_price)
            price = learner.act(view)
        if price is None:
            price = float(self._policy.act(view))
        return {"buy_price": price}

    def answer(self, request: PolicyRequest) -> PolicyReply:
        """What the policy would do, row by row."""
        facts = self._facts
        assert facts is not None

        def act(row: dict[str, float]) -> float:
            cost = np.array([row[f"facility_cost_{i + 1}"] for i in range(facts.facilities)])
            outcome = (row["payments"], int(row["homes"]), row["demand_kw"], row["sell_price"])
            view = GridView(0, slot_of(row, facts), facts.dt_h, cost, None, *outcome, self._levels)
            return float(self._policy.act(view))

        policy = self._policy
        if self._learning is not None and not self._learning.grid.watches:
            policy = GridNetwork(self._learning.grid.file(), facts)
        return policy_reply(self.request.agent, policy, grid_features("public", facts.facilities, 0), request, act)


def play(options: argparse.Namespace) -> None:
    """Take part until the market is over."""
    request = JoinRequest(
        agent="grid",
        role="grid",
        instance=new_instance(),
        policy=options.policy,
        observation=options.observation,
        encoding=options.encoding,
    )
    learning = Learning(options, "grid", "grid") if options.learn else None
    with AgentLink("grid", options.run, options.connect, certs=options.certs, timeout_s=options.timeout) as link:
        Grid(link, request, learning).live()
