"""How well a prosumer can do at best: its best response to known prices, and what agents still leave on the table."""

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
"""Levels tried from each of them, besides those at which a bill has its kinks."""

MOST_STATES = 600
"""States of the lattice where given commands reach so many different ones that they are interpolated."""


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

    With ``commands_kw`` and lossless batteries with evenly spread commands the bill is the least that *those commands*
    can reach, to rounding. In all other cases it is the bill of a day that can really be had, so the true least bill
    is at or below it; ``best_response_milp`` gives that one. The tests hold the difference below half a cent a day (two
    cents where the meter's limit is in reach), and to rounding in the case study.

    Among equally cheap days it takes the one with the emptiest battery: ties decide nothing for the prosumer, and much
    for the grid (see ``zengrid.core.leader``).

    Parameters
    ----------
    market:
        Homes and slot length; the facilities play no part.
    pv_kw, load_kw:
        ``(slot, ..., home)``. [kW]
    buy_price, sell_price:
        ``(slot, ...)``. [$/kWh]
    soc:
        At the start, ``(..., home)``, and ``(home,)`` with ``commands_kw``; None takes the homes' initial one. [-]
    terminal:
        ``free``: the battery may end at any state of charge; ``cyclic``: not below where it started.
    commands_kw:
        The only commands permitted, ``(level, home)``; None permits any power. [kW]
    states:
        Of the lattice, for each home. Memory grows as slots x days x states x homes.
    hold_price:
        Decides between equally cheap days; negative prefers the fuller battery. [$/kWh/h]
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
    """What commands ``(slot, ..., home)`` come to, by the rules of ``settle``: power, state of charge and bill."""
    battery, path, bill = [], [soc], np.zeros(())
    for slot, command in enumerate(command_kw):
        battery_kw, after = battery_step(path[-1], command, market)
        _, export_kw, import_kw, _, _ = meter(pv_kw[slot] - load_kw[slot] - battery_kw, market)
        bought, sold = buy_price[slot] * market.dt_h, sell_price[slot] * market.dt_h
        bill = bill + (import_kw * sold[..., None] - export_kw * bought[..., None])
        battery.append(battery_kw)
        path.append(after)
    return BestResponse(np.stack(battery), np.stack(path), bill)


def best_response_milp(
    market: MarketParams,
    pv_kw: Floats,
    load_kw: Floats,
    buy_price: Floats,
    sell_price: Floats,
    soc: Floats | None = None,
    terminal: Terminal = "free",
) -> BestResponse:
    """Best response of every home to known prices and profiles, by a mixed-integer program with HiGHS.

    Commands are any power. The bill is the least that any agent can reach, to the solver's tolerances (1e-6 kW in each
    slot, a relative gap of 1e-9): no agent can beat it. Arguments and result are those of ``best_response``. Each home
    and day is a program of its own: milliseconds where the sell price is at least the buy price and the meter's limit
    is out of reach, seconds where not.
    """
    homes = market.homes.count
    start = market.homes.soc_initial if soc is None else soc
    lead = np.broadcast_shapes(pv_kw.shape[1:-1], buy_price.shape[1:], sell_price.shape[1:], start.shape[:-1])
    slots = pv_kw.shape[0]
    net_kw = np.broadcast_to(pv_kw - load_kw, (slots, *lead, homes))
    buy, sell = (np.broadcast_to(price, (slots, *lead)) for price in (buy_price, sell_price))
    start = np.broadcast_to(start, (*lead, homes))
    commands = np.empty(net_kw.shape)
    for day in np.ndindex(*lead):
        for home in range(homes):
            commands[(slice(None), *day, home)] = _milp(
                market, home, net_kw[(slice(None), *day, home)], buy[(slice(None), *day)], sell[(slice(None), *day)],
                float(start[(*day, home)]), terminal,
            )  # fmt: skip
    return replay(market, pv_kw, load_kw, buy_price, sell_price, start, commands)


def _milp(
    market: MarketParams, home: int, net_kw: Floats, buy: Floats, sell: Floats, soc: float, terminal: Terminal
) -> Floats:
    """Commands of one home and day, ``(slot,)``. [kW]

    Continuous in each slot: charge, discharge, import, export, curtailed, unserved power [kW], energy stored at the
    slot's end [kWh]. Binary: whether it charges, whether it imports, and whether the meter's limit binds for exports
    and imports. They forbid what would pay in a linear program and cannot be: buying and selling at once where the
    buy price is above the sell price, losing energy on purpose in a battery that charges and discharges at once, and
    going unserved (or curtailing) below the limit.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import coo_array

    homes, dt_h, slots = market.homes, market.dt_h, net_kw.size
    capacity, limit = float(homes.capacity_kwh[home]), float(homes.injection_max_kw[home])
    charge_max, discharge_max = float(homes.charge_max_kw[home]), float(homes.discharge_max_kw[home])
    e_c, e_d = float(homes.charge_efficiency[home]), float(homes.discharge_efficiency[home])
    low, high = float(homes.soc_min[home]) * capacity, float(homes.soc_max[home]) * capacity
    curtailed_max = np.maximum(net_kw + discharge_max - limit, 0.0)
    unserved_max = np.maximum(charge_max - net_kw - limit, 0.0)

    zero, one = np.zeros(slots), np.ones(slots)
    lossy = one * (e_c * e_d < 1.0)
    curtails, goes_short = (curtailed_max > 0.0) * one, (unserved_max > 0.0) * one
    cost = {"import": sell * dt_h, "export": -buy * dt_h}
    upper = {
        "charge": one * charge_max, "discharge": one * discharge_max, "import": one * limit, "export": one * limit,
        "curtailed": curtailed_max, "unserved": unserved_max, "energy": one * high,
        "charging": one, "importing": one, "curtailing": curtails, "short": goes_short,
    }  # fmt: skip
    lower = {"energy": np.append(one[1:] * low, max(low, soc * capacity) if terminal == "cyclic" else low)}
    whole = {
        "charging": lossy, "importing": np.maximum((buy > sell) * one, np.maximum(curtails, goes_short)),
        "curtailing": curtails, "short": goes_short,
    }  # fmt: skip
    column = {name: number * slots + np.arange(slots) for number, name in enumerate(upper)}
    rows, columns, values, least, most = [], [], [], [], []
    count = 0

    def require(terms: dict[str, Floats | float], at_least: Floats | float, at_most: Floats | float) -> None:
        """One row a slot: at_least <= sum of factor * variable <= at_most."""
        nonlocal count
        for name, factor in terms.items():
            # "energy before" is the energy at the end of the slot before.
            first, name = (1, "energy") if name == "energy before" else (0, name)
            rows.append(count + np.arange(first, slots))
            columns.append(column[name][: slots - first])
            values.append(np.broadcast_to(factor, (slots,))[first:])
        least.append(np.broadcast_to(at_least, (slots,)))
        most.append(np.broadcast_to(at_most, (slots,)))
        count += slots

    at_start = np.append(soc * capacity, zero[1:])
    meter_terms: dict[str, Floats | float] = {"import": 1, "unserved": 1, "export": -1, "curtailed": -1}
    require({**meter_terms, "charge": -1, "discharge": 1}, -net_kw, -net_kw)
    require({"energy": 1, "energy before": -1, "charge": -e_c * dt_h, "discharge": dt_h / e_d}, at_start, at_start)
    require({"charge": 1, "charging": -charge_max}, -np.inf, 0.0)
    require({"discharge": 1, "charging": discharge_max}, -np.inf, discharge_max)
    require({"import": 1, "importing": -limit}, -np.inf, 0.0)
    require({"export": 1, "importing": limit}, -np.inf, limit)
    require({"curtailed": 1, "curtailing": -curtailed_max}, -np.inf, 0.0)
    require({"export": 1, "curtailing": -limit}, 0.0, np.inf)
    require({"unserved": 1, "short": -unserved_max}, -np.inf, 0.0)
    require({"import": 1, "short": -limit}, 0.0, np.inf)
    matrix = coo_array(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, len(upper) * slots)
    ).tocsc()
    solved = milp(
        np.concatenate([cost.get(name, zero) for name in upper]),
        integrality=np.concatenate([whole.get(name, zero) for name in upper]),
        bounds=Bounds(np.concatenate([lower.get(name, zero) for name in upper]), np.concatenate(list(upper.values()))),
        constraints=LinearConstraint(matrix, np.concatenate(least), np.concatenate(most)),
        options={"mip_rel_gap": 1e-9},
    )
    if solved.x is None:
        raise ValueError(f"best response of home {home}, start soc = {soc:g}: {solved.message}")
    commands: Floats = solved.x[column["charge"]] - solved.x[column["discharge"]]
    return commands


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
    """What each home would still gain by its best response while all others, and the prices, stay as they are.

    This is the exploitability of a prosumer's policy, hindsight included: no causal policy need reach 0 on noisy days.

    Parameters
    ----------
    bill:
        What the home really paid over the same slots, ``(..., home)``. [$]

    Other parameters are those of ``best_response``. Where stored energy carries over from day to day, give all days as
    one horizon of many slots.

    Returns
    -------
    ``(..., home)``, at least 0 but for the lattice's approximation. [$]
    """
    return bill - best_response(market, pv_kw, load_kw, buy_price, sell_price, soc, terminal).bill
