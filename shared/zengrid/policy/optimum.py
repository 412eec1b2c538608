"""The prosumer that knows the future: a best response to known profiles and to known or expected prices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.bounds import MOVES, STATES
from zengrid.core.lattice import CostToGo, Lattice
from zengrid.core.levels import level_commands
from zengrid.core.params import Facilities, MarketParams
from zengrid.errors import PolicyError, ScenarioError
from zengrid.policy.facts import Foresight, MarketFacts
from zengrid.policy.prices import price_schedule, price_steps
from zengrid.policy.seed import read_seed
from zengrid.policy.views import DayNumber, ProsumerView

if TYPE_CHECKING:
    from zengrid.scenario import HomeSpec, Scenario

Floats = NDArray[np.float64]

SAME_KW = 1e-6
"""Power further than this from what was foreseen is another day. [kW]"""


class Optimum:
    """Plays, in each slot, the first command of a cheapest rest of the horizon.

    It knows its homes' PV and consumption of every day exactly, and the posted tariff. Of buy prices it knows the
    schedule, if one is given. If not, it expects each slot's price of the day before; and on its first day, the price
    of the present slot for the slots it has not seen. The price of the present slot is always the real one.

    The horizon is the day where batteries are reset daily, and the day and the next one where stored energy is carried
    over (expecting the same prices on both). At its end stored energy is worth nothing. Plans follow from the day and
    the expected prices alone, so an agent that is started again goes on with the same commands where a schedule is
    given, and forgets what it saw of prices where none is.

    Days side by side (leading axes) are planned side by side, each to the last bit as if it were alone.
    """

    name = "optimum"
    version = "1"

    def __init__(self, facts: MarketFacts, foresight: Foresight, schedule: Floats | None = None) -> None:
        self._ids = facts.home_ids
        # Facilities play no part in what a home pays.
        self._market = MarketParams(facts.homes, Facilities.of(0.0, 0.0), facts.dt_h)
        self._lattice = Lattice.even(self._market, STATES)
        self._commands_kw = level_commands(MOVES, facts.homes)
        self._days = 1 if facts.soc_reset == "daily" else 2
        self._sell = np.array(facts.sell_prices)
        self._foresight = foresight
        self._schedule = schedule
        self._day: DayNumber | None = None
        self._seen = self._before = self._net_kw = self._planned_for = np.empty(0)
        self._plan: CostToGo | None = None

    def act(self, view: ProsumerView) -> Floats:
        """Commands, ``(..., home)``. [kW]

        Raises
        ------
        PolicyError
            Where PV or consumption is not what was foreseen: it then looks at another scenario or seed.
        """
        price = np.asarray(view.buy_price, dtype=np.float64)
        if self._day is None or not np.array_equal(view.day, self._day):
            self._begin(view.day, price.shape)
        expected = self._expected(price)
        if self._plan is None or not np.array_equal(expected, self._planned_for):
            self._plan, self._planned_for = self._make_plan(expected), expected
        net_kw = view.pv_kw - view.load_kw
        self._check(view, net_kw)
        self._seen[view.slot] = price
        return self._plan.decide(view.slot, view.soc, net_kw, price, np.asarray(view.sell_price))

    def _begin(self, day: DayNumber, lead: tuple[int, ...]) -> None:
        """A new day: what was seen of prices so far is what is expected of them."""
        slots = (self._sell.size, *lead)
        if self._seen.shape != slots:
            self._seen = np.full(slots, np.nan)
        self._day, self._plan, self._before = day, None, self._seen.copy()
        profiles = [self._profile(np.asarray(day) + ahead) for ahead in range(self._days)]
        self._net_kw = np.concatenate(profiles)

    def _profile(self, days: NDArray[np.int64]) -> Floats:
        """PV less consumption, ``(slot, ..., home)``. [kW]"""
        each = {int(day): np.subtract(*self._foresight(int(day))) for day in np.unique(days)}
        stacked = np.stack([each[int(day)] for day in days.flat], axis=1)
        return stacked.reshape(len(stacked), *days.shape, -1)

    def _expected(self, price: Floats) -> Floats:
        """Buy prices of the day, ``(slot, ...)``. [$/kWh]"""
        if self._schedule is not None:
            return self._schedule.reshape(-1, *(1 for _ in price.shape))
        return np.where(np.isnan(self._before), price, self._before)

    def _make_plan(self, expected: Floats) -> CostToGo:
        sell = self._sell.reshape(-1, *(1 for _ in expected.shape[1:]))
        return CostToGo(
            self._market,
            self._lattice,
            self._commands_kw,
            True,
            self._net_kw,
            np.concatenate([expected] * self._days),
            np.concatenate([sell] * self._days),
        )

    def _check(self, view: ProsumerView, net_kw: Floats) -> None:
        off = np.abs(net_kw - self._net_kw[view.slot])
        if off.max(initial=0.0) > SAME_KW:
            home = self._ids[int(np.unravel_index(off.argmax(), off.shape)[-1])]
            raise PolicyError(
                f"optimum: PV less consumption of home {home} on day {view.day}, slot {view.slot} is {off.max():.3g} "
                "kW off what was foreseen; scenario and seed must be those of the market"
            )


class Options(NamedTuple):
    """What stands behind the colon of ``optimum:``."""

    scenario: str | None = None
    """where profiles are looked up; None: what the market's facts offer"""
    seed: int | None = None
    data: str | None = None
    prices: str | None = None
    """the schedule to expect"""

    @property
    def files(self) -> tuple[str, ...]:
        """What it reads that is no part of zengrid."""
        from zengrid.scenario import BUILTIN

        named = () if self.scenario is None or self.scenario in BUILTIN else (self.scenario,)
        return named if self.data is None else (*named, self.data)


def read_options(text: str) -> Options:
    """Options as in ``scenario=paper,seed=3,data=homes,prices=0.05,18:00=0.09``; prices come last: they have commas.

    Raises
    ------
    PolicyError
        Where they are wrong whatever the market.
    """
    options, has_prices, prices = text.partition("prices=")
    given = dict(part.partition("=")[::2] for part in options.split(",") if part)
    unknown = set(given) - {"scenario", "seed", "data"}
    if unknown:
        raise PolicyError(f"{', '.join(sorted(unknown))}: permitted are scenario, seed, data and, at the end, prices")
    if has_prices:
        price_steps(prices)
    seed = given.get("seed")
    return Options(
        given.get("scenario"), read_seed(seed) if seed else None, given.get("data"), prices if has_prices else None
    )


def make_optimum(facts: MarketFacts, options: Options) -> Optimum:
    """An optimum for a market."""
    foresight = facts.foresight
    if foresight is None or options._replace(prices=None) != Options():
        foresight = _look_into(facts, options)
    return Optimum(facts, foresight, None if options.prices is None else price_schedule(options.prices, facts))


def _look_into(facts: MarketFacts, options: Options) -> Foresight:
    """The homes' profiles out of a scenario."""
    name = facts.scenario if options.scenario is None else options.scenario
    if not name:
        raise PolicyError("it must know the future: give scenario=NAME (and seed=N), as the market was started with")
    from zengrid.scenario import load  # only who looks into a scenario needs to read one

    try:
        scenario = load(name, data=None if options.data is None else Path(options.data), seed=options.seed)
        strangers = [home for home in facts.home_ids if home not in scenario.home_ids]
        if strangers:
            there = ", ".join(scenario.home_ids[:10])
            raise PolicyError(f"scenario = {name} does not have home {strangers[0]}: it has {there}")
        if scenario.slots_per_day != facts.slots_per_day:
            slots = scenario.slots_per_day
            raise PolicyError(f"scenario = {name} has {slots} slots a day, the market {facts.slots_per_day}")
        return foresight_of(scenario, [scenario.homes[scenario.home_ids.index(home)] for home in facts.home_ids])
    except ScenarioError as error:
        raise PolicyError(f"scenario = {name}: {error}") from None


def foresight_of(scenario: Scenario, homes: Sequence[HomeSpec]) -> Foresight:
    """What days of a scenario will bring to some homes, its own or brought ones; reads the scenario's data."""
    from zengrid.scenario import Days

    days = Days(scenario)
    return lambda number: days.homes_day(homes, number)
