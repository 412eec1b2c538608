"""The least bill that a home can have on a known day, by a mixed-integer program with HiGHS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.bounds import BestResponse, Terminal, replay
from zengrid.core.params import Homes, MarketParams

Floats = NDArray[np.float64]
Terms = Mapping[str, Floats | float]
"""Factor of each variable in a constraint, for each slot or one for all."""


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

    Any power is allowed. No agent can reach a lower bill, up to the solver's tolerances (1e-6 kW in each slot, a
    relative gap of 1e-9). Arguments and result are those of ``best_response``. Each home and day is a separate program.
    It takes milliseconds if the sell price is at least the buy price and the meter's limit cannot bind, else seconds.
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
            commands[(slice(None), *day, home)] = _commands(
                market, home, net_kw[(slice(None), *day, home)], buy[(slice(None), *day)], sell[(slice(None), *day)],
                float(start[(*day, home)]), terminal,
            )  # fmt: skip
    return replay(market, pv_kw, load_kw, buy_price, sell_price, start, commands)


class _Home(NamedTuple):
    """What the program must know of one home."""

    charge_max_kw: float
    discharge_max_kw: float
    charge_efficiency: float
    discharge_efficiency: float
    injection_max_kw: float
    low_kwh: float
    high_kwh: float

    @classmethod
    def of(cls, homes: Homes, home: int) -> _Home:
        """The home at a position."""
        capacity_kwh = float(homes.capacity_kwh[home])
        low_kwh, high_kwh = float(homes.soc_min[home]) * capacity_kwh, float(homes.soc_max[home]) * capacity_kwh
        return cls(
            charge_max_kw=float(homes.charge_max_kw[home]),
            discharge_max_kw=float(homes.discharge_max_kw[home]),
            charge_efficiency=float(homes.charge_efficiency[home]),
            discharge_efficiency=float(homes.discharge_efficiency[home]),
            injection_max_kw=float(homes.injection_max_kw[home]),
            low_kwh=low_kwh,
            high_kwh=high_kwh,
        )


class _Variable(NamedTuple):
    """One variable in each slot, ``(slot,)`` or one number for all slots."""

    upper: Floats | float
    lower: Floats | float = 0.0
    cost: Floats | float = 0.0
    whole: Floats | float = 0.0
    """1 where the variable must be a whole number"""


class _Program:
    """A mixed-integer program whose variables and constraints repeat in each slot."""

    def __init__(self, slots: int, variables: Mapping[str, _Variable]) -> None:
        self._slots = slots
        self._variables = variables
        self._column = {name: number * slots + np.arange(slots) for number, name in enumerate(variables)}
        self._rows: list[NDArray[np.intp]] = []
        self._columns: list[NDArray[np.intp]] = []
        self._factors: list[Floats] = []
        self._least: list[Floats] = []
        self._most: list[Floats] = []

    def require(self, terms: Terms, at_least: Floats | float, at_most: Floats | float) -> None:
        """Add a constraint for each slot: at_least <= sum of factor * variable <= at_most.

        The variable "energy before" is the energy at the end of the slot before; the first slot has none.
        """
        slots, count = self._slots, len(self._least) * self._slots
        for term, factor in terms.items():
            first, name = (1, "energy") if term == "energy before" else (0, term)
            self._rows.append(count + np.arange(first, slots))
            self._columns.append(self._column[name][: slots - first])
            self._factors.append(np.broadcast_to(factor, (slots,))[first:])
        self._least.append(np.broadcast_to(at_least, (slots,)))
        self._most.append(np.broadcast_to(at_most, (slots,)))

    def solve(self) -> dict[str, Floats]:
        """Values of the variables at the least cost, ``(slot,)`` each.

        Raises
        ------
        ValueError
            The solver finds none.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import coo_array

        def of_all(field: str) -> Floats:
            values = [getattr(variable, field) for variable in self._variables.values()]
            return np.concatenate([np.broadcast_to(value, (self._slots,)) for value in values])

        matrix = coo_array(
            (np.concatenate(self._factors), (np.concatenate(self._rows), np.concatenate(self._columns))),
            shape=(len(self._least) * self._slots, len(self._variables) * self._slots),
        ).tocsc()
        solved = milp(
            of_all("cost"),
            integrality=of_all("whole").astype(np.int64),
            bounds=Bounds(of_all("lower"), of_all("upper")),
            constraints=LinearConstraint(matrix, np.concatenate(self._least), np.concatenate(self._most)),
            options={"mip_rel_gap": 1e-9},
        )
        if solved.x is None:
            raise ValueError(solved.message)
        return {name: solved.x[column] for name, column in self._column.items()}


def _commands(
    market: MarketParams, position: int, net_kw: Floats, buy: Floats, sell: Floats, soc: float, terminal: Terminal
) -> Floats:
    """Commands of one home and day, ``(slot,)``. [kW]

    Continuous in each slot: charge, discharge, import, export, curtailed, unserved power [kW], energy stored at the
    slot's end [kWh]. Binary: whether it charges, whether it imports, and whether the meter's limit binds for exports
    and imports. The binaries forbid what would pay in a linear program but is impossible: to buy and sell at once where
    the buy price is above the sell price, to lose energy on purpose in a battery that charges and discharges at once,
    and to go unserved (or curtail) below the limit.
    """
    home, dt_h, slots = _Home.of(market.homes, position), market.dt_h, net_kw.size
    start_kwh = soc * float(market.homes.capacity_kwh[position])
    limit = home.injection_max_kw
    curtailed_max = np.maximum(net_kw + home.discharge_max_kw - limit, 0.0)
    unserved_max = np.maximum(home.charge_max_kw - net_kw - limit, 0.0)
    curtails, goes_short = ((most > 0.0).astype(np.float64) for most in (curtailed_max, unserved_max))
    arbitrage = (buy > sell).astype(np.float64)
    end_kwh = max(home.low_kwh, start_kwh) if terminal == "cyclic" else home.low_kwh
    lossy = 1.0 * (home.charge_efficiency * home.discharge_efficiency < 1.0)
    program = _Program(slots, {
        "charge": _Variable(home.charge_max_kw),
        "discharge": _Variable(home.discharge_max_kw),
        "import": _Variable(limit, cost=sell * dt_h),
        "export": _Variable(limit, cost=-buy * dt_h),
        "curtailed": _Variable(curtailed_max),
        "unserved": _Variable(unserved_max),
        "energy": _Variable(home.high_kwh, lower=np.append(np.full(slots - 1, home.low_kwh), end_kwh)),
        "charging": _Variable(1.0, whole=lossy),
        "importing": _Variable(1.0, whole=np.maximum(arbitrage, np.maximum(curtails, goes_short))),
        "curtailing": _Variable(curtails, whole=curtails),
        "short": _Variable(goes_short, whole=goes_short),
    })  # fmt: skip
    _require_energy(program, home, net_kw, start_kwh, dt_h)
    program.require({"charge": 1, "charging": -home.charge_max_kw}, -np.inf, 0.0)
    program.require({"discharge": 1, "charging": home.discharge_max_kw}, -np.inf, home.discharge_max_kw)
    program.require({"import": 1, "importing": -limit}, -np.inf, 0.0)
    program.require({"export": 1, "importing": limit}, -np.inf, limit)
    program.require({"curtailed": 1, "curtailing": -curtailed_max}, -np.inf, 0.0)
    program.require({"export": 1, "curtailing": -limit}, 0.0, np.inf)
    program.require({"unserved": 1, "short": -unserved_max}, -np.inf, 0.0)
    program.require({"import": 1, "short": -limit}, 0.0, np.inf)
    try:
        solved = program.solve()
    except ValueError as error:
        raise ValueError(f"best response of home {position}, start soc = {soc:g}: {error}") from error
    return solved["charge"] - solved["discharge"]


def _require_energy(program: _Program, home: _Home, net_kw: Floats, start_kwh: float, dt_h: float) -> None:
    """Balance power at the meter and energy in the battery."""
    meter: dict[str, Floats | float] = {"import": 1, "unserved": 1, "export": -1, "curtailed": -1}
    program.require({**meter, "charge": -1, "discharge": 1}, -net_kw, -net_kw)
    at_start = np.append(start_kwh, np.zeros(net_kw.size - 1))
    stored: dict[str, Floats | float] = {"energy": 1, "energy before": -1}
    program.require(
        {**stored, "charge": -home.charge_efficiency * dt_h, "discharge": dt_h / home.discharge_efficiency},
        at_start, at_start,
    )  # fmt: skip
