"""The environment of the live market: its homes, what the day brings them, and the twin without demand response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.settle import settle
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.scenario import homes_params

if TYPE_CHECKING:
    from zengrid.journal import SlotRecord
    from zengrid.scenario import Days, HomeSpec, Scenario

Floats = NDArray[np.float64]


DAYS_AHEAD = 32
VALUES_AHEAD = 100_000
"""How many days are generated at once: so many, or so many values of one column, whichever is less."""


class LastSlot(NamedTuple):
    """What agents are told of the last settled slot; per home it follows the homes that come and go."""

    payment: Floats
    bill: Floats
    battery_kw: Floats
    injection_kw: Floats
    facility_cost: Floats
    demand_kw: float
    profit: float

    def with_homes(self, change: Callable[[Floats], Floats]) -> LastSlot:
        """The same slot with another set of homes."""
        return self._replace(
            payment=change(self.payment),
            bill=change(self.bill),
            battery_kw=change(self.battery_kw),
            injection_kw=change(self.injection_kw),
        )


class LiveMarket:
    """One market, slot after slot, with homes that come and go.

    Beside the real market runs its twin without demand response: the same homes on the same days under the
    conventional rule and price.
    """

    def __init__(self, scenario: Scenario, days: Days) -> None:
        self.scenario = scenario
        self.day, self.slot = -1, 0
        self._days = days
        self._ahead: dict[int, Exogenous] = {}
        self.agents: dict[str, slice] = {}
        self.specs: list[HomeSpec] = list(scenario.homes)
        self.homes: tuple[str, ...] = scenario.home_ids
        self.market = scenario.market()
        start = 0
        for agent in scenario.agents:
            self.agents[agent.id] = slice(start, start + len(agent.homes))
            start += len(agent.homes)
        initial = self.market.homes.soc_initial
        self.soc, self.conventional_soc = initial.copy(), initial.copy()
        self.last: LastSlot | None = None

    @property
    def slots_per_day(self) -> int:
        """Slots of a day."""
        return self.scenario.slots_per_day

    def begin_day(self, day: int, slot: int = 0) -> None:
        """Load what a day brings, to go on from the given slot; reset the batteries where the scenario says so."""
        self.day, self.slot = day, slot
        if slot == 0 and self.scenario.soc_reset == "daily":
            initial = self.market.homes.soc_initial
            self.soc, self.conventional_soc = initial.copy(), initial.copy()
        self._load_day()

    def _load_day(self) -> None:
        """Profiles of the homes that are there now, and what the conventional rule commands them."""
        self._profile = self._days_ahead(self.day)
        if self.homes != self.scenario.home_ids:
            pv_kw, load_kw = self._days.homes_day(self.specs, self.day)
            self._profile = self._profile._replace(pv_kw=pv_kw, load_kw=load_kw)
        self._command = conventional(self._profile.pv_kw, self._profile.load_kw, self.market.homes)

    def _days_ahead(self, day: int) -> Exogenous:
        """A day of the scenario; some are made at once, because one by one each costs as much as all of them."""
        if day not in self._ahead:
            values = self.slots_per_day * max(len(self.scenario.homes), 1)
            numbers = np.arange(day, day + max(1, min(DAYS_AHEAD, VALUES_AHEAD // values)))
            block = self._days.days(numbers)
            self._ahead = {int(number): Exogenous(*(column[i] for column in block)) for i, number in enumerate(numbers)}
        return self._ahead[day]

    def sell_prices(self, day: int) -> list[float]:
        """The posted tariff of a day, one price a slot. [$/kWh]"""
        profile = self._profile if day == self.day else self._days.day(day)
        return [float(price) for price in profile.sell_price]

    def check(self, spec: HomeSpec) -> None:
        """Raise ScenarioError where this market has no profile for a home."""
        self._days.home_day(spec, max(self.day, 0))

    def profile(self, slot: int) -> Exogenous:
        """PV, loads and tariff of one slot of the current day."""
        return self._profile.slot(slot)

    def twin(self, slot: int, exogenous: Exogenous) -> Settlement:
        """The coming slot without demand response."""
        price = np.asarray(self.scenario.conventional_buy_price)
        return settle(self.conventional_soc, Action(price, self._command[slot]), exogenous, self.market)

    def fallback(self, slot: int) -> Floats:
        """Commands for homes whose agent does not answer, from the conventional rule; a copy to write into."""
        command: Floats = self._command[slot].copy()
        return command

    def settle(self, action: Action, exogenous: Exogenous) -> Settlement:
        """What came of a slot; nothing changes before ``advance``."""
        return settle(self.soc, action, exogenous, self.market)

    def advance(self, settled: Settlement, twin: Settlement) -> None:
        """Continue from a settled (and journalled) slot."""
        self.slot += 1
        self.soc, self.conventional_soc = settled.soc, twin.soc
        self.last = LastSlot(
            settled.payment, settled.bill, settled.battery_kw, settled.injection_kw, settled.facility_cost,
            float(settled.demand_kw), float(settled.profit),
        )  # fmt: skip

    def restore(self, specs: Sequence[HomeSpec], agents: dict[str, slice], record: SlotRecord) -> None:
        """Go back to the state that a journal ends with."""
        self._set_homes(list(specs), agents)
        self.soc, self.conventional_soc = record.soc.copy(), record.conventional_soc.copy()
        # The same product as in ``settle``, so that what agents see does not depend on where the clock was restarted.
        payment = np.maximum(record.injection_kw, 0.0) * (record.buy_price * self.scenario.dt_h)
        self.last = LastSlot(
            payment, record.bill, record.battery_kw, record.injection_kw, record.facility_cost,
            record.demand_kw, record.profit,
        )  # fmt: skip

    def add(self, agent: str, specs: Sequence[HomeSpec]) -> None:
        """Add an agent's homes behind those that are there."""
        count = len(self.specs)
        last = self.last
        self._set_homes([*self.specs, *specs], {**self.agents, agent: slice(count, count + len(specs))})
        initial = self.market.homes.soc_initial[count:]
        self.soc = np.concatenate([self.soc, initial])
        self.conventional_soc = np.concatenate([self.conventional_soc, initial])
        zeros = np.zeros(len(specs))
        if last is not None:
            self.last = last.with_homes(lambda old: np.concatenate([old, zeros]))
        if self.day >= 0:
            self._load_day()

    def remove(self, agent: str) -> None:
        """Take an agent's homes out."""
        gone = self.agents[agent]
        keep = np.r_[0 : gone.start, gone.stop : len(self.specs)]
        width = gone.stop - gone.start
        agents = {
            name: part if part.start < gone.start else slice(part.start - width, part.stop - width)
            for name, part in self.agents.items()
            if name != agent
        }
        self._set_homes([self.specs[i] for i in keep], agents)
        self.soc, self.conventional_soc = self.soc[keep], self.conventional_soc[keep]
        if self.last is not None:
            self.last = self.last.with_homes(lambda old: old[keep])
        if self.day >= 0:
            self._load_day()

    def _set_homes(self, specs: list[HomeSpec], agents: dict[str, slice]) -> None:
        self.specs, self.agents = specs, agents
        self.homes = tuple(spec.id for spec in specs)
        self.market = self.market.with_homes(homes_params(specs))
