"""Writes each agent's observation: what it may see of the slot, and the reward of its previous slot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from zengrid.core.state import Exogenous
from zengrid.wire.codec import BINARY, JSON, encode_fields
from zengrid_clock.barrier import SlotPhase

if TYPE_CHECKING:
    from zengrid_clock.agent_registry import MarketAgent
    from zengrid_clock.live_market import LiveMarket

Columns = dict[str, Any]
"""Columns of all homes, as arrays or as lists: both are cut into the agents' parts alike."""


class ObservationWriter:
    """Writes observations as bytes, in the encoding that the agent asked for.

    ``begin_phase`` collects what all agents see; ``encode`` adds an agent's own part. All that prosumers see, except
    the price, is known before the grid agent has set it: ``encode_ahead`` uses the time in which it decides. The fields
    are those of ``FleetObservation`` and ``GridObservation``.
    """

    def __init__(self, run: str, market: LiveMarket) -> None:
        self.run = run
        self.market = market
        self._common: dict[str, Any] = {}
        self._buy_price = 0.0
        self._settled: dict[str, Any] | None = None
        """The slot that was settled last, and its price."""
        self._arrays: tuple[Columns, Columns] = ({}, {})
        self._lists: tuple[Columns, Columns] | None = None
        self._encoded_ahead: dict[str, bytes] = {}
        """JSON of each prosumer agent up to its last field, the price."""
        self._price_field = b""

    def slot_settled(self, day: int, slot: int, buy_price: float) -> None:
        """From now on observations carry the outcome of this slot."""
        self._settled = {"v": 1, "day": day, "slot": slot, "buy_price": buy_price}

    def begin_phase(self, phase: SlotPhase, exogenous: Exogenous, deadline_s: float, *, end: bool = False) -> None:
        """Collect what all agents see in a phase, or at the end of the market."""
        market, last = self.market, self.market.last
        self._common = {
            "v": 1,
            "run": self.run,
            "day": phase.day,
            "slot": phase.slot,
            "phase": "end" if end else phase.phase,
            "hour": phase.slot * market.scenario.dt_h,
            "deadline_s": deadline_s,
            "sell_price": float(exogenous.sell_price),
        }
        if phase.phase == "price":
            return
        own = {"soc": market.soc, "pv_kw": exogenous.pv_kw, "load_kw": exogenous.load_kw}
        outcome: Columns = {}
        if last is not None:
            outcome = {"reward": -last.bill, "battery_kw": last.battery_kw, "injection_kw": last.injection_kw}
        self._arrays, self._lists = (own, outcome), None
        self._encoded_ahead = {}

    def encode_ahead(self, agent: MarketAgent) -> None:
        """Encode all but the price of a prosumer agent's observation, after ``begin_phase`` of the battery phase."""
        if agent.encoding == "json":
            self._encoded_ahead[agent.id] = self._encode_without_price(agent)

    def set_price(self, buy_price: float) -> None:
        """The price that prosumers see. [$/kWh]"""
        self._buy_price = buy_price
        self._price_field = b',"buy_price":%b}' % repr(buy_price).encode()

    def encode(self, agent: MarketAgent) -> tuple[bytes, str]:
        """An agent's observation (paper eq. 14 and 15), and its encoding."""
        encoding = BINARY if agent.encoding == "binary" else JSON
        if agent.role == "grid":
            return encode_fields(self._grid(agent), encoding), encoding
        if encoding == JSON:
            ahead = self._encoded_ahead.get(agent.id) or self._encode_without_price(agent)
            return ahead + self._price_field, JSON
        return encode_fields({**self._fleet(agent), "buy_price": self._buy_price}, BINARY), BINARY

    def _grid(self, agent: MarketAgent) -> dict[str, Any]:
        last = self.market.last
        homes = len(self.market.homes)
        payment = last.payment if last is not None else np.zeros(homes)
        facilities = self.market.params.facilities.count
        return {
            **self._common,
            "homes": homes,
            "facility_cost": last.facility_cost if last is not None else np.zeros(facilities),
            "payment": payment if agent.observation == "paper" else None,
            "payments": float(np.add.reduce(payment)),
            "demand_kw": last.demand_kw if last is not None else 0.0,
            "settled": self._settled_of(agent, {"reward": 0.0 if last is None else last.profit}),
        }

    def _fleet(self, agent: MarketAgent) -> dict[str, Any]:
        """All but the price."""
        cut = self.market.agents[agent.id]
        if agent.encoding == "binary":
            own, outcome = self._arrays
        else:
            if self._lists is None:
                # Cutting one list is much cheaper than turning every agent's piece of an array into a list.
                own, outcome = ({name: array.tolist() for name, array in part.items()} for part in self._arrays)
                self._lists = own, outcome
            own, outcome = self._lists
        settled = self._settled_of(agent, {name: column[cut] for name, column in outcome.items()})
        return {**self._common, "settled": settled, **{name: column[cut] for name, column in own.items()}}

    def _settled_of(self, agent: MarketAgent, outcome: dict[str, Any]) -> dict[str, Any] | None:
        """The outcome of an agent's last slot, if it took part in one."""
        if self._settled is None or not agent.played_last_slot:
            return None
        return {**self._settled, "fallback": not agent.acted_last, **outcome}

    def _encode_without_price(self, agent: MarketAgent) -> bytes:
        return encode_fields(self._fleet(agent)).removesuffix(b"}")
