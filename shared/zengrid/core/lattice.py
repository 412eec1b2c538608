"""Dynamic programming over batteries' states of charge: least cost of the rest of a known day, and best command."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.home_physics import battery_step, meter
from zengrid.core.params import MarketParams

Floats = NDArray[np.float64]

SAME_SOC = 1e-7
"""States of charge closer than this count as equal. [-]"""

HOLD_PRICE = 1e-9
"""Price of holding a stored kWh for an hour: it makes the emptier of two equally cheap days the cheaper one.

It is far below any price and far above rounding, so results do not depend on the order of additions.
[$/kWh/h]
"""

FINE = 8
"""Factor by which a decision tries more levels than the backward pass if any power is allowed."""

SHORTFALL_PRICE = 1e3
"""Price of ending below a required state of charge: more than energy can earn in a day. [$/kWh]"""


class Lattice:
    """States of charge between which a dynamic program moves.

    Parameters
    ----------
    soc:
        Ascending along the first axis, ``(state, home)``, at least two states. [-]
    """

    def __init__(self, soc: Floats) -> None:
        self.soc = np.ascontiguousarray(soc)
        self.states, self.homes = soc.shape
        self._column = np.arange(self.homes)
        # Homes one after the other on one line, each in its own interval of length 2: one search serves all.
        self._line = (self.soc + 2.0 * self._column).T.ravel()

    @classmethod
    def even(cls, market: MarketParams, states: int) -> Lattice:
        """Evenly spread states from the lowest to the highest permitted state of charge of each home."""
        homes = market.homes
        share = np.linspace(0.0, 1.0, states)[:, None]
        return cls(homes.soc_min * (1.0 - share) + homes.soc_max * share)

    @classmethod
    def closed(cls, market: MarketParams, commands_kw: Floats, soc: Floats, most: int) -> Lattice | None:
        """All states that any sequence of the given commands can reach, or None if there are more than ``most``.

        Lossless batteries with evenly spread levels reach few: three evenly spaced sets, which start from the given
        state and from both limits. With losses almost every sequence ends at another state.

        Parameters
        ----------
        commands_kw:
            ``(level, home)``. [kW]
        soc:
            State of charge at which each home starts, ``(home,)``. [-]
        """
        homes = market.homes
        columns = []
        for home in range(homes.count):
            alone = market.with_homes(homes.take([home]))
            known = np.empty(0)
            new = _distinct(np.array([soc[home], homes.soc_min[home], homes.soc_max[home]]), known)
            while new.size:
                known = np.sort(np.concatenate([known, new]))
                if known.size > most:
                    return None
                _, after = battery_step(new[:, None, None], commands_kw[:, home : home + 1], alone)
                new = _distinct(after.ravel(), known)
            columns.append(known)
        states = max(2, *(column.size for column in columns))
        return cls(np.stack([np.pad(column, (0, states - column.size), "edge") for column in columns], axis=1))

    def locate(self, soc: Floats) -> tuple[NDArray[np.intp], Floats | None]:
        """Find the positions of states of charge ``(..., home)``.

        Returns
        -------
        below, share:
            Flat position in ``(state, home)`` of the state at or below, and the share of the way to the next one. The
            share is None if all of them are states of the lattice.
        """
        rank = np.searchsorted(self._line, soc + 2.0 * self._column + SAME_SOC, side="right") - 1
        state = np.minimum(np.maximum(rank - self._column * self.states, 0), self.states - 1)
        next_state = np.minimum(state + 1, self.states - 1)
        start = self.soc[state, self._column]
        gap = self.soc[next_state, self._column] - start
        share = np.where(gap > SAME_SOC, (soc - start) / np.where(gap > SAME_SOC, gap, 1.0), 0.0)
        # Snapped, so that the last bit of a state of charge changes nothing.
        share = np.where(share * gap < SAME_SOC, 0.0, share)
        return state * self.homes + self._column, share if share.any() else None


class CostToGo:
    """Least cost of the rest of a known horizon for each home, from every state and at every slot.

    ``V_t(soc) = min over commands of bill_t(soc, command) + V_{t+1}(soc')``, linear between the states.

    If the lattice is closed under the commands (``Lattice.closed``), this is exact for them. On an even lattice it is
    interpolated and never below the true cost if costs are convex in the state of charge. They are if the sell price is
    at least the buy price and the meter's limit cannot bind.

    Parameters
    ----------
    commands_kw:
        Commands to choose from, ``(level, home)``. [kW]
    any_power:
        Whether other commands are allowed too. Then the commands at which the slope of the bill changes are also tried
        (they bring the meter to zero or to its limits, or the battery to the state required at the end), and
        ``decide`` tries ``FINE`` times as many levels.
    net_kw:
        PV less consumption, ``(slot, ..., home)``. [kW]
    buy_price, sell_price:
        ``(slot, ...)``. [$/kWh]
    end_soc:
        Least state of charge at the end, ``(..., home)``; None: any. [-]
    hold_price:
        Chooses between equally cheap days: a positive one prefers the emptier battery. [$/kWh/h]
    """

    def __init__(
        self,
        market: MarketParams,
        lattice: Lattice,
        commands_kw: Floats,
        any_power: bool,
        net_kw: Floats,
        buy_price: Floats,
        sell_price: Floats,
        end_soc: Floats | None = None,
        hold_price: float = HOLD_PRICE,
    ) -> None:
        self.market = market
        self.lattice = lattice
        self.any_power = any_power
        self.commands_kw = refine(commands_kw, FINE) if any_power else commands_kw
        self._end_soc = end_soc
        self._hold = hold_price * market.dt_h * market.homes.capacity_kwh
        self.lead = lead = np.broadcast_shapes(net_kw.shape[1:-1], buy_price.shape[1:], sell_price.shape[1:])
        # Nothing follows the last slot: the cost of its end does not come from the lattice.
        self.value: list[Floats | None] = [None]
        """One ``(..., state, home)`` a slot [$], and None for the end."""
        fixed = [self._step(lattice.soc, command) for command in commands_kw]
        for slot in range(net_kw.shape[0] - 1, -1, -1):
            net = net_kw[slot][..., None, :]
            buy, sell = buy_price[slot][..., None], sell_price[slot][..., None]
            best = np.full((*lead, lattice.states, lattice.homes), np.inf)
            for step in [*fixed, *(self._step(lattice.soc, kink) for kink in self._kinks(lattice.soc, net))]:
                np.minimum(best, self._cost(step, net, buy, sell, self.value[-1]), out=best)
            self.value.append(best)
        self.value.reverse()

    def decide(self, slot: int, soc: Floats, net_kw: Floats, buy_price: Floats, sell_price: Floats) -> Floats:
        """The cheapest command in a slot, from any state of charge and with any prices in this slot.

        Parameters
        ----------
        soc, net_kw:
            ``(..., home)``. [-], [kW]
        buy_price, sell_price:
            ``(...)``. [$/kWh]

        Returns
        -------
        Command, ``(..., home)``; of equally cheap commands the one that discharges most. [kW]
        """
        at, net = soc[..., None, :], net_kw[..., None, :]
        commands = [np.broadcast_to(kink, (*soc.shape[:-1], 1, soc.shape[-1])) for kink in self._kinks(at, net)]
        levels = np.broadcast_to(self.commands_kw, (*soc.shape[:-1], *self.commands_kw.shape))
        # The axis of the lattice's states now holds the commands.
        step = self._step(at, np.concatenate([levels, *commands], axis=-2))
        buy, sell = np.asarray(buy_price)[..., None], np.asarray(sell_price)[..., None]
        cost = self._cost(step, net, buy, sell, self.value[slot + 1])
        battery_kw = np.broadcast_to(step.battery_kw, cost.shape)
        chosen: Floats = np.take_along_axis(battery_kw, np.argmin(cost, axis=-2)[..., None, :], axis=-2)[..., 0, :]
        return chosen

    def _kinks(self, soc: Floats, net_kw: Floats) -> list[Floats]:
        """Commands at which the slope of a slot's bill changes. [kW]"""
        if not self.any_power:
            return []
        kinks = [net_kw]
        limit, full = self.market.homes.injection_max_kw, self.market.homes
        if np.any(net_kw + full.discharge_max_kw > limit):
            kinks.append(net_kw - limit)
        if np.any(full.charge_max_kw - net_kw > limit):
            kinks.append(net_kw + limit)
        if self._end_soc is not None:
            missing = self._end_soc[..., None, :] - soc
            kinks.append(
                np.maximum(missing, 0.0) * self.market.kw_per_soc_charged
                + np.minimum(missing, 0.0) * self.market.kw_per_soc_drawn
            )
        return kinks

    def _step(self, soc: Floats, command_kw: Floats) -> _Step:
        battery_kw, after = battery_step(soc, command_kw, self.market)
        return _Step(battery_kw, after, *self.lattice.locate(after))

    def _cost(self, step: _Step, net_kw: Floats, buy: Floats, sell: Floats, value: Floats | None) -> Floats:
        """Bill of the slot and cost of the slots after it, ``(..., state, home)``. [$]"""
        _, export_kw, import_kw, _, _ = meter(net_kw - step.battery_kw, self.market)
        dt_h = self.market.dt_h
        # In this order the first sum seldom has leading axes, which makes it cheap.
        cost: Floats = (
            step.after * self._hold + import_kw * (sell * dt_h)[..., None] - export_kw * (buy * dt_h)[..., None]
        )
        if value is None:
            if self._end_soc is not None:
                missing = np.maximum(self._end_soc[..., None, :] - step.after - SAME_SOC, 0.0)
                cost = cost + missing * (SHORTFALL_PRICE * self.market.homes.capacity_kwh)
            return cost
        flat = value.reshape(*value.shape[:-2], -1)
        below = _pick(flat, step.below)
        if step.share is None:
            return cost + below
        above = _pick(flat, np.minimum(step.below + self.lattice.homes, flat.shape[-1] - 1))
        return cost + (below + step.share * (above - below))


class _Step(NamedTuple):
    """Effect of a command from some states: actual power, state of charge after it, and its position."""

    battery_kw: Floats
    after: Floats
    below: NDArray[np.intp]
    share: Floats | None


def refine(commands_kw: Floats, times: int) -> Floats:
    """Divide each interval between levels ``(level, home)`` into ``times`` parts. [kW]"""
    share = np.arange(times)[:, None] / times
    between = commands_kw[:-1, None] * (1.0 - share) + commands_kw[1:, None] * share
    return np.concatenate([between.reshape(-1, commands_kw.shape[1]), commands_kw[-1:]])


def _pick(flat: Floats, index: NDArray[np.intp]) -> Floats:
    """Entries of the last axis, ``(..., state, home)``; the index has the leading axes or none."""
    if index.ndim == 2:
        return np.take(flat, index, axis=-1)
    lead = np.broadcast_shapes(flat.shape[:-1], index.shape[:-2])
    rows = np.broadcast_to(index, (*lead, *index.shape[-2:])).reshape(*lead, -1)
    picked = np.take_along_axis(np.broadcast_to(flat, (*lead, flat.shape[-1])), rows, axis=-1)
    return picked.reshape(*lead, *index.shape[-2:])


def _distinct(soc: Floats, known: Floats) -> Floats:
    """Sort, without repetitions and without states that are in ``known`` (ascending)."""
    soc = np.sort(soc)
    soc = soc[np.diff(soc, prepend=-1.0) > SAME_SOC]
    if not known.size:
        return soc
    right = np.minimum(np.searchsorted(known, soc), known.size - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.minimum(np.abs(known[right] - soc), np.abs(known[left] - soc))
    new: Floats = soc[nearest > SAME_SOC]
    return new
