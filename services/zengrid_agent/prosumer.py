"""A prosumer agent: sees its own homes, commands their batteries."""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from zengrid.bus.agent_link import AgentLink
from zengrid.bus.machine_name import machine_name
from zengrid.core.observe import prosumer_features
from zengrid.errors import PolicyError, ScenarioError
from zengrid.policy import trained
from zengrid.policy.facts import Foresight
from zengrid.policy.network import ProsumerNetwork
from zengrid.policy.registry import make_prosumer_policy
from zengrid.policy.views import ProsumerPolicy, ProsumerView
from zengrid.scenario.home_spec import HomeSpec
from zengrid.validation import first_error
from zengrid.wire.queries import JoinReply, JoinRequest, PolicyReply, PolicyRequest
from zengrid.wire.slot_structs import FleetObservationStruct
from zengrid_agent.answers import policy_reply, slot_of
from zengrid_agent.facts import market_facts
from zengrid_agent.learning import Learning
from zengrid_agent.session import AgentSession, new_instance

AUTO = "auto"
"""An id of nobody: whichever home is free."""
NAME_MAX = 40
"""Leaves room for what follows the name in ``instance``, and for a number where it is taken."""


class Prosumer(AgentSession[FleetObservationStruct]):
    """Plays one agent's homes with a policy that is made when the market is known."""

    observation = FleetObservationStruct

    def __init__(self, link: AgentLink, request: JoinRequest, learning: Learning | None = None) -> None:
        super().__init__(link, request, learning)
        self._market: JoinReply | None = None

    def welcome(self, market: JoinReply) -> None:
        """Make the policy for these homes."""
        if self._market is not None and self._market.homes == market.homes:
            return
        facts = market_facts(market, market.homes)
        if self.request.policy.partition(":")[0] == "optimum":
            facts = replace(facts, foresight=self._foresight(market))
        self._dt_h, self._homes = facts.dt_h, facts.homes
        self._policy = make_prosumer_policy(self.request.policy, facts)
        if self._learning is not None:
            self.say(self._learning.begin(facts, self.request.policy))
        elif self.request.policy == "trained":
            self.say(f"{self.request.agent} plays {trained.for_prosumer(facts).why}")
        self._market = market

    def _foresight(self, market: JoinReply) -> Foresight:
        """What the coming days bring to these homes: only the perfect-foresight optimum may know."""
        from zengrid.policy.optimum import foresight_of
        from zengrid.scenario import loads

        scenario = loads(self.link.scenario())
        described = {home.id: home for home in (*scenario.homes, *(self.request.homes or ()))}
        return foresight_of(scenario, [described[home.id] for home in market.homes])

    def act(self, seen: FleetObservationStruct) -> dict[str, Any]:
        """Command every battery."""
        view = ProsumerView(
            seen.day,
            seen.slot,
            self._dt_h,
            np.asarray(seen.soc),
            np.asarray(seen.pv_kw),
            np.asarray(seen.load_kw),
            seen.buy_price,
            seen.sell_price,
            self._homes,
        )
        battery_kw = None
        if self._learning is not None:
            learner = self._learning.prosumer
            if seen.settled is not None:
                last = seen.settled
                learner.hear(last.day, last.slot, last.reward, last.fallback)
            battery_kw = learner.act(view)
        if battery_kw is None:
            battery_kw = self._policy.act(view)
        return {"battery_kw": battery_kw}

    def answer(self, request: PolicyRequest) -> PolicyReply:
        """What the policy would do with one home, row by row."""
        assert self._market is not None
        homes = self._market.homes if request.home is None else [h for h in self._market.homes if h.id == request.home]
        if not homes:
            names = ", ".join(home.id for home in self._market.homes[:10])
            raise PolicyError(f"home = {request.home}: {self.request.agent} plays {names}")
        facts = market_facts(self._market, homes[:1])
        policy: ProsumerPolicy
        if self._learning is not None and not self._learning.prosumer.watches:
            policy = ProsumerNetwork(self._learning.prosumer.file(), facts)
        else:
            policy = make_prosumer_policy(self.request.policy, facts)

        def act(row: dict[str, float]) -> float:
            soc, pv_kw, load_kw = (np.array([row[name]]) for name in ("soc", "pv_kw", "load_kw"))
            prices = row["buy_price"], row["sell_price"]
            view = ProsumerView(0, slot_of(row, facts), facts.dt_h, soc, pv_kw, load_kw, *prices, facts.homes)
            return float(policy.act(view)[0])

        return policy_reply(self.request.agent, policy, prosumer_features("public"), request, act)


def play(options: argparse.Namespace) -> None:
    """Take part until the market is over."""
    unclaimed = options.id == AUTO
    if unclaimed:
        options.id = f"home-{machine_name()}"[:NAME_MAX].rstrip("-_")
    brings = options.pv is not None or options.battery is not None or options.home is not None
    request = JoinRequest(
        agent=options.id,
        role="prosumer",
        # By its name the clock knows a process again that takes whichever home is free.
        instance=f"{options.id}.{new_instance()}" if unclaimed else new_instance(),
        policy=options.policy,
        homes=(_home(options),) if brings else None,
        unclaimed=unclaimed,
        observation=options.observation,
        encoding=options.encoding,
    )
    learning = Learning(options, options.id, "prosumer") if options.learn else None
    with AgentLink(options.id, options.run, options.connect, certs=options.certs, timeout_s=options.timeout) as link:
        Prosumer(link, request, learning).live()


def _home(options: argparse.Namespace) -> HomeSpec:
    battery: dict[str, Any] = {"capacity_kwh": options.battery or 0.0}
    if options.battery_power is not None:
        battery |= {"charge_max_kw": options.battery_power, "discharge_max_kw": options.battery_power}
    load = {"profile": options.load, "scale": options.load_scale}
    given: dict[str, Any] = {
        "id": options.id,
        "pv_kw": options.pv or 0.0,
        "battery": battery,
        "load": {name: value for name, value in load.items() if value is not None},
        "seed": options.seed or 0,
    }
    try:
        if options.home is not None:
            return HomeSpec.model_validate_json(options.home)
        return HomeSpec.model_validate(given)
    except ValidationError as error:
        raise ScenarioError(f"home {options.id}: {first_error(error)}") from None
