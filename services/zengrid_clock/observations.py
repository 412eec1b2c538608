"""What the clock tells each agent: its local observation, and the reward of its previous slot."""

from __future__ import annotations

from typing import Any

import numpy as np

from zengrid.core.state import Exogenous
from zengrid.wire.codec import BINARY, JSON, encode_fields
from zengrid_clock.barrier import Moment
from zengrid_clock.market import LiveMarket
from zengrid_clock.roster import Agent

Columns = dict[str, Any]
"""Columns of all homes, as arrays or as lists: both are cut into the agents' parts alike."""


class Observer:
    """Builds observations as bytes in the encoding that the agent asked for.

    What all agents are told alike is put together once a phase by ``look``; ``tell`` adds an agent's own part. What
    prosumers are told is known, but for the price, before the grid agent has set it: ``write_ahead`` uses the time in
    which it thinks. The fields are those of ``FleetObservation`` and ``GridObservation``.
    """

    def __init__(self, run: str, market: LiveMarket) -> None:
        self.run = run
        self.market = market
        self._head: dict[str, Any] = {}
        self._buy_price = 0.0
        self._settled: dict[str, Any] | None = None
        """Which slot was settled last, and at which price."""
        self._arrays: tuple[Columns, Columns] = ({}, {})
        self._lists: tuple[Columns, Columns] | None = None
        self._written: dict[str, bytes] = {}
        """JSON of each prosumer agent up to its last field, the price"""
        self._rest = b""

    def settled(self, day: int, slot: int, buy_price: float) -> None:
        """Take note of the slot that was settled last."""
        self._settled = {"v": 1, "day": day, "slot": slot, "buy_price": buy_price}

    def look(self, moment: Moment, exogenous: Exogenous, deadline_s: float, *, end: bool = False) -> None:
        """Take in the market at one moment: before the price is set, for those who answer to it, or at the end."""
        market, last = self.market, self.market.last
        self._head = {
            "v": 1,
            "run": self.run,
            "day": moment.day,
            "slot": moment.slot,
            "phase": "end" if end else moment.phase,
            "hour": moment.slot * market.scenario.dt_h,
            "deadline_s": deadline_s,
            "sell_price": float(exogenous.sell_price),
        }
        if moment.phase == "price":
            return
        own = {"soc": market.soc, "pv_kw": exogenous.pv_kw, "load_kw": exogenous.load_kw}
        outcome: Columns = {}
        if last is not None:
            outcome = {"reward": -last.bill, "battery_kw": last.battery_kw, "injection_kw": last.injection_kw}
        self._arrays, self._lists = (own, outcome), None
        self._written = {}

    def write_ahead(self, agent: Agent) -> None:
        """Write all but the price, after a look at what prosumers are to be told."""
        if agent.encoding == "json":
            self._written[agent.id] = self._without_price(agent)

    def set_price(self, buy_price: float) -> None:
        """The price that prosumers are told. [$/kWh]"""
        self._buy_price = buy_price
        self._rest = b',"buy_price":%b}' % repr(buy_price).encode()

    def tell(self, agent: Agent) -> tuple[bytes, str]:
        """An agent's observation (paper eq. 14 and 15), and its encoding."""
        encoding = BINARY if agent.encoding == "binary" else JSON
        if agent.role == "grid":
            return encode_fields(self._grid(agent), encoding), encoding
        if encoding == JSON:
            return (self._written.get(agent.id) or self._without_price(agent)) + self._rest, JSON
        return encode_fields({**self._fleet(agent), "buy_price": self._buy_price}, BINARY), BINARY

    def _grid(self, agent: Agent) -> dict[str, Any]:
        last = self.market.last
        homes = len(self.market.homes)
        payment = last.payment if last is not None else np.zeros(homes)
        return {
            **self._head,
            "homes": homes,
            "facility_cost": last.facility_cost if last is not None else np.zeros(self.market.market.facilities.count),
            "payment": payment if agent.observation == "paper" else None,
            "payments": float(np.add.reduce(payment)),
            "demand_kw": last.demand_kw if last is not None else 0.0,
            "settled": self._settled_of(agent, {"reward": 0.0 if last is None else last.profit}),
        }

    def _fleet(self, agent: Agent) -> dict[str, Any]:
        """All but the price."""
        mine = self.market.agents[agent.id]
        if agent.encoding == "binary":
            own, outcome = self._arrays
        else:
            if self._lists is None:
                # Cutting one list is much cheaper than turning every agent's piece of an array into a list.
                own, outcome = ({name: array.tolist() for name, array in part.items()} for part in self._arrays)
                self._lists = own, outcome
            own, outcome = self._lists
        settled = self._settled_of(agent, {name: column[mine] for name, column in outcome.items()})
        return {**self._head, "settled": settled, **{name: column[mine] for name, column in own.items()}}

    def _settled_of(self, agent: Agent, outcome: dict[str, Any]) -> dict[str, Any] | None:
        """What came of an agent's last slot, where it took part in one."""
        if self._settled is None or not agent.settled:
            return None
        return {**self._settled, "fallback": not agent.acted_last, **outcome}

    def _without_price(self, agent: Agent) -> bytes:
        return encode_fields(self._fleet(agent)).removesuffix(b"}")
