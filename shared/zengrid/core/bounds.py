"""A prosumer's best response to known prices, and how far an agent is from it."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.home_physics import battery_step, meter
from zengrid.core.lattice import HOLD_PRICE, CostToGo, Lattice
from zengrid.core.levels import level_commands
from zengrid.core.params import MarketParams

Floats = NDArray[np.float64]
Terminal = Literal["free", "cyclic"]

STATES = 97
"""States of the lattice for each home where any power is permitted."""

MOVES = 9
"""Commands tried from each of them, besides those at which the slope of the bill changes."""

MOST_STATES = 600
"""Most states of a lattice. Commands that reach more are interpolated on a lattice of this size."""


class BestResponse(NamedTuple):
    """A cheapest day of each home, replayed with the rules of ``settle``.

    battery_kw: ``(slot, ..., home)`` what each battery does, > 0 charges. [kW]
    soc: ``(slot + 1, ..., home)`` from the start to the end of the day. [-]
    bill: ``(..., home)`` for the whole day. [$]
    """

    battery_kw: Floats
    soc: Floats
    bill: Floats


def best_response(
    market: MarketParams,
    pv_kw: Floats,
    load_kw: Floats,
    buy_price: Floats,
    sell_price: Floats,
    soc: Floats | None = None,
    terminal: Terminal = "free",
    commands_kw: Floats | None = None,
    states: int = STATES,
    hold_price: float = HOLD_PRICE,
) -> BestResponse:
    """Best response of every home to known prices and profiles, by dynamic programming.

    With evenly spread ``commands_kw`` and lossless batteries the bill is the least that *those commands* can reach, up
    to rounding. Otherwise it is that of a feasible day, at or above the least one (``zengrid.core.milp``): in the tests
    by half a cent a day at most, two cents if the meter's limit can bind. Of equally cheap days it takes the one with
    the emptiest battery, which matters to the grid alone (see ``zengrid.core.leader``).

    Parameters
    ----------
    market:
        Homes and slot length; the facilities are not used.
    pv_kw, load_kw:
        ``(slot, ..., home)``. [kW]
    buy_price, sell_price:
        ``(slot, ...)``. [$/kWh]
    soc:
        State of charge at the start, ``(..., home)``, and ``(home,)`` with ``commands_kw``; None: the initial one. [-]
    terminal:
        ``free``: the battery may end at any state of charge; ``cyclic``: not below where it started.
    commands_kw:
        The only commands allowed, ``(level, home)``; None allows any power. [kW]
    states:
        States of the lattice for each home. Memory grows as slots x days x states x homes.
    hold_price:
        Chooses between equally cheap days; a negative one prefers the fuller battery. [$/kWh/h]
    """
    start = market.homes.soc_initial if soc is None else soc
    lattice = None if commands_kw is None else Lattice.closed(market, commands_kw, start, MOST_STATES)
    if lattice is None:
        lattice = Lattice.even(market, states if commands_kw is None else MOST_STATES)
    plan = CostToGo(
        market,
        lattice,
        level_commands(MOVES, market.homes) if commands_kw is None else commands_kw,
        commands_kw is None,
        pv_kw - load_kw,
        buy_price,
        sell_price,
        start if terminal == "cyclic" else None,
        hold_price,
    )
    path = [np.broadcast_to(start, (*plan.lead, market.homes.count))]
    commands = []
    for slot in range(pv_kw.shape[0]):
        net_kw = pv_kw[slot] - load_kw[slot]
        commands.append(plan.decide(slot, path[-1], net_kw, buy_price[slot], sell_price[slot]))
        path.append(battery_step(path[-1], commands[-1], market)[1])
    return replay(market, pv_kw, load_kw, buy_price, sell_price, path[0], np.stack(commands))


def replay(
    market: MarketParams,
    pv_kw: Floats,
    load_kw: Floats,
    buy_price: Floats,
    sell_price: Floats,
    soc: Floats,
    command_kw: Floats,
) -> BestResponse:
    """Apply commands ``(slot, ..., home)`` by the rules of ``settle``; returns power, state of charge and bill."""
    battery, path, bill = [], [soc], np.zeros(())
    for slot, command in enumerate(command_kw):
        battery_kw, after = battery_step(path[-1], command, market)
        _, export_kw, import_kw, _, _ = meter(pv_kw[slot] - load_kw[slot] - battery_kw, market)
        bought, sold = buy_price[slot] * market.dt_h, sell_price[slot] * market.dt_h
        bill = bill + (import_kw * sold[..., None] - export_kw * bought[..., None])
        battery.append(battery_kw)
        path.append(after)
    return BestResponse(np.stack(battery), np.stack(path), bill)


def optimality_gap(
    market: MarketParams,
    pv_kw: Floats,
    load_kw: Floats,
    buy_price: Floats,
    sell_price: Floats,
    bill: Floats,
    soc: Floats | None = None,
    terminal: Terminal = "free",
) -> Floats:
    """How much each home would save with its best response while all others and the prices stay as they are.

    This is the exploitability of a prosumer's policy with hindsight: on noisy days no causal policy reaches 0.

    Parameters
    ----------
    bill:
        The home's actual bill over the same slots, ``(..., home)``. [$]

    The other parameters are those of ``best_response``. If stored energy carries over from day to day, pass all days as
    one horizon of many slots.

    Returns
    -------
    ``(..., home)``, at least 0 up to the error of the lattice. [$]
    """
    return bill - best_response(market, pv_kw, load_kw, buy_price, sell_price, soc, terminal).bill
