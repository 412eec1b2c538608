"""What the clock tells each agent: its local observation, and the reward of its previous slot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zengrid.core.state import Exogenous
from zengrid.wire.codec import BINARY, JSON, encode
from zengrid.wire.slots import FleetObservation, FleetSettled, GridObservation, GridSettled
from zengrid_clock.barrier import Moment
from zengrid_clock.market import LiveMarket
from zengrid_clock.roster import Agent


class Settled(NamedTuple):
    """Which slot was settled last, and at which price."""

    day: int
    slot: int
    buy_price: float


class Observer:
    """Builds observations as bytes in the encoding that the agent asked for."""

    def __init__(self, run: str, market: LiveMarket) -> None:
        self.run = run
        self.market = market
        self.settled: Settled | None = None

    def grid(self, agent: Agent, moment: Moment, exogenous: Exogenous, deadline_s: float) -> tuple[bytes, str]:
        """The grid agent's observation (paper eq. 14)."""
        sell_price = float(exogenous.sell_price)
        return _encode(self._grid(agent, moment.day, moment.slot, sell_price, deadline_s, end=False), agent)

    def fleet(
        self, agent: Agent, moment: Moment, exogenous: Exogenous, buy_price: float, deadline_s: float
    ) -> tuple[bytes, str]:
        """A prosumer agent's observation (paper eq. 15)."""
        mine = self.market.agents[agent.id]
        message = FleetObservation.trusted(
            v=1,
            run=self.run,
            day=moment.day,
            slot=moment.slot,
            phase="battery",
            hour=moment.slot * self.market.scenario.dt_h,
            deadline_s=deadline_s,
            buy_price=buy_price,
            sell_price=float(exogenous.sell_price),
            soc=self.market.soc[mine],
            pv_kw=exogenous.pv_kw[mine],
            load_kw=exogenous.load_kw[mine],
            settled=self._fleet_settled(agent, mine),
        )
        return _encode(message, agent)

    def farewell(self, agent: Agent, day: int, slot: int) -> tuple[bytes, str]:
        """The last message to an agent: the market is over, here is the last reward."""
        if agent.role == "grid":
            return _encode(self._grid(agent, day, slot, 0.0, 1.0, end=True), agent)
        mine = self.market.agents[agent.id]
        nothing = np.zeros(mine.stop - mine.start)
        message = FleetObservation.trusted(
            v=1,
            run=self.run,
            day=day,
            slot=slot,
            phase="end",
            hour=slot * self.market.scenario.dt_h,
            deadline_s=1.0,
            buy_price=0.0,
            sell_price=0.0,
            soc=self.market.soc[mine],
            pv_kw=nothing,
            load_kw=nothing,
            settled=self._fleet_settled(agent, mine),
        )
        return _encode(message, agent)

    def _grid(
        self, agent: Agent, day: int, slot: int, sell_price: float, deadline_s: float, *, end: bool
    ) -> GridObservation:
        last, settled = self.market.last, self.settled
        homes = len(self.market.homes)
        payment = last.payment if last is not None else np.zeros(homes)
        return GridObservation.trusted(
            v=1,
            run=self.run,
            day=day,
            slot=slot,
            phase="end" if end else "price",
            hour=slot * self.market.scenario.dt_h,
            deadline_s=deadline_s,
            sell_price=sell_price,
            homes=homes,
            facility_cost=last.facility_cost if last is not None else np.zeros(self.market.market.facilities.count),
            payment=payment if agent.observation == "paper" else None,
            payment_sum=float(np.add.reduce(payment)),
            demand_kw=last.demand_kw if last is not None else 0.0,
            settled=None
            if last is None or settled is None
            else GridSettled.trusted(v=1, **settled._asdict(), reward=last.profit, fallback=not agent.acted_last),
        )

    def _fleet_settled(self, agent: Agent, mine: slice) -> FleetSettled | None:
        last, settled = self.market.last, self.settled
        if last is None or settled is None or not agent.settled:
            return None
        return FleetSettled.trusted(
            v=1,
            **settled._asdict(),
            reward=-last.bill[mine],
            battery_kw=last.battery_kw[mine],
            injection_kw=last.injection_kw[mine],
            fallback=not agent.acted_last,
        )


def _encode(message: GridObservation | FleetObservation, agent: Agent) -> tuple[bytes, str]:
    encoding = BINARY if agent.encoding == "binary" else JSON
    return encode(message, encoding), encoding
