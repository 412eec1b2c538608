"""Thousands of days side by side: the market in which agents are trained, on the same ``settle`` as the live one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zengrid.core.observe import ObservationKind, observe_grid, observe_prosumers, time_features
from zengrid.core.params import HOME_FIELDS, Homes, MarketParams
from zengrid.core.settle import settle, total
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.policy.views import DayNumber, GridView, ProsumerView

Floats = NDArray[np.float64]


class VectorMarket:
    """One market on many days at once; every day is played as if it were alone, to the last bit.

    A day begins with ``begin``; then, slot by slot: ``grid_observation`` (or ``grid_view``), the choice of a buy price,
    ``prosumer_observation`` (or ``prosumer_view``) under that price, and ``step``.

    Parameters
    ----------
    market:
        Homes, facilities and slot length; from ``beside`` for variants of a market on a leading axis.
    lead:
        Shape of what is played side by side: ``(day,)``, ``(seed, day)``, ``(variant, day)``, ``()``.
    buy_prices:
        Levels of the buy price, ``(level,)``. [$/kWh]
    """

    def __init__(self, market: MarketParams, lead: tuple[int, ...] = (), buy_prices: ArrayLike = ()) -> None:
        self.market = market
        self.lead = lead
        self.buy_prices = np.asarray(buy_prices, dtype=np.float64)
        self.homes = market.homes.count
        self.slot = 0
        self.day: DayNumber = 0
        self.soc = np.broadcast_to(market.homes.soc_initial, (*lead, self.homes))
        # What the grid agent is told before anything was settled.
        self._facility_cost = np.zeros((*lead, market.facilities.count))
        self._payment = np.zeros((*lead, self.homes))
        self._demand_kw = np.zeros(lead)

    def begin(self, profile: Exogenous, soc: Floats | None = None, day: DayNumber = 0) -> None:
        """Begin a day, and remember the outcome of the last slot, as the live market does.

        Parameters
        ----------
        profile:
            What the day brings, ``(slot, ..., home)`` and so on, broadcast against ``lead``.
        soc:
            State of charge to begin with, ``(..., home)``; None goes on with what is stored. [-]
        day:
            Its number, or ``(...)`` numbers, for policies that ask.
        """
        self._profile, self.slots, self.day, self.slot = profile, profile.sell_price.shape[0], day, 0
        if soc is not None:
            self.soc = np.broadcast_to(np.asarray(soc, dtype=np.float64), (*self.lead, self.homes))

    def memory(self) -> dict[str, Floats]:
        """What goes on from one day into the next."""
        return {
            "soc": self.soc, "facility_cost": self._facility_cost, "payment": self._payment,
            "demand_kw": self._demand_kw,
        }  # fmt: skip

    def remember(self, memory: dict[str, Floats]) -> None:
        """Go on from what ``memory`` gave."""
        self.soc, self._demand_kw = memory["soc"], memory["demand_kw"]
        self._facility_cost, self._payment = memory["facility_cost"], memory["payment"]

    @property
    def over(self) -> bool:
        """Whether the day has no slot left."""
        return self.slot == self.slots

    @property
    def now(self) -> Exogenous:
        """What the coming slot brings."""
        return self._profile.slot(self.slot)

    @property
    def time(self) -> tuple[float, float]:
        """Sine and cosine of the time of day."""
        return time_features(self.slot, self.market.dt_h)

    def grid_observation(self, kind: ObservationKind) -> Floats:
        """What the grid agent sees before it sets the price, ``(..., feature)``."""
        sell_price = np.broadcast_to(self.now.sell_price, self.lead)
        return observe_grid(kind, self._facility_cost, self._payment, self._demand_kw, sell_price, self.time)

    def prosumer_observation(self, kind: ObservationKind, buy_price: Floats | float) -> Floats:
        """What each prosumer sees once the price ``(...)`` is set, ``(..., home, feature)``."""
        now = self.now
        return observe_prosumers(kind, self.soc, now.pv_kw, now.load_kw, buy_price, now.sell_price, self.time)

    def grid_view(self) -> GridView:
        """The same for policies."""
        return GridView(
            day=self.day,
            slot=self.slot,
            dt_h=self.market.dt_h,
            facility_cost=self._facility_cost,
            payment=self._payment,
            payments=total(self._payment),
            homes=self.homes,
            demand_kw=self._demand_kw,
            sell_price=np.broadcast_to(self.now.sell_price, self.lead),
            buy_prices=self.buy_prices,
        )

    def prosumer_view(self, buy_price: Floats | float, homes: slice = slice(None)) -> ProsumerView:
        """The same for policies: one slot as the agent of some neighbouring homes sees it."""
        now = self.now
        return ProsumerView(
            day=self.day,
            slot=self.slot,
            dt_h=self.market.dt_h,
            soc=self.soc[..., homes],
            pv_kw=np.broadcast_to(now.pv_kw, self.soc.shape)[..., homes],
            load_kw=np.broadcast_to(now.load_kw, self.soc.shape)[..., homes],
            buy_price=buy_price,
            sell_price=np.broadcast_to(now.sell_price, self.lead)[()],
            homes=self.market.homes if homes == slice(None) else self.market.homes.take(homes_index(homes, self.homes)),
        )

    def step(self, buy_price: Floats | float, battery_kw: Floats) -> Settlement:
        """Settle the slot under a buy price ``(...)`` [$/kWh] and commands ``(..., home)`` [kW]."""
        if self.over:
            raise IndexError(f"slot = {self.slot}: the day has {self.slots} slots and is over; begin the next")
        settled = settle(self.soc, Action(np.asarray(buy_price), battery_kw), self.now, self.market)
        self.soc = settled.soc
        self._facility_cost, self._payment = settled.facility_cost, settled.payment
        self._demand_kw = settled.demand_kw
        self.slot += 1
        return settled


def homes_index(homes: slice, count: int) -> NDArray[np.intp]:
    """Positions that a slice picks out of so many homes."""
    return np.arange(count)[homes]


def beside(markets: Sequence[MarketParams]) -> MarketParams:
    """Variants of a market as one, for leading axes ``(variant, day)``: arrays of its homes are ``(variant, 1, home)``.

    The variants differ in their homes alone, and have the same number of them.
    """
    first = markets[0]
    for market in markets[1:]:
        same = market.dt_h == first.dt_h and market.value_of_lost_load == first.value_of_lost_load
        for f in fields(first.facilities):
            same &= np.array_equal(getattr(market.facilities, f.name), getattr(first.facilities, f.name))
        if not same:
            raise ValueError("markets: side by side they may differ in their homes alone")
        if market.homes.count != first.homes.count:
            raise ValueError(f"markets: {market.homes.count} homes beside {first.homes.count}; permitted: equally many")
    homes = {name: np.stack([getattr(market.homes, name) for market in markets])[:, None, :] for name in HOME_FIELDS}
    return first.with_homes(Homes(**homes))


def slots_first(days: Exogenous) -> Exogenous:
    """Days as ``zengrid.scenario`` makes them, ``(day, slot, ...)``, with the slot in front, for ``begin``."""
    return Exogenous(*(np.ascontiguousarray(np.moveaxis(column, 1, 0)) for column in days))


def pick(profile: Exogenous, index: NDArray[np.intp] | int) -> Exogenous:
    """Some days of many, ``(slot, day, ...)`` -> ``(slot, *index.shape, ...)``."""
    return profile.part((slice(None), index))
