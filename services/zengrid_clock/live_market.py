"""The environment of the live market: its homes, their profiles of the day, and the baseline beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.settle import Prepared, conclude, prepare
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.errors import SettlementError
from zengrid.scenario import homes_params
from zengrid_clock.baseline_ahead import BaselineAhead
from zengrid_clock.profiles_ahead import ProfilesAhead

if TYPE_CHECKING:
    from zengrid.journal import SlotRecord
    from zengrid.journal.slot_record import BaselineSlot
    from zengrid.scenario import Days, HomeSpec, Scenario

Floats = NDArray[np.float64]


class LastOutcome(NamedTuple):
    """What agents see of the last settled slot; the columns of homes follow the homes that come and go."""

    payment: Floats
    bill: Floats
    battery_kw: Floats
    injection_kw: Floats
    facility_cost: Floats
    demand_kw: float
    profit: float

    def with_homes(self, change: Callable[[Floats], Floats]) -> LastOutcome:
        """The same slot with another set of homes."""
        return self._replace(
            payment=change(self.payment),
            bill=change(self.bill),
            battery_kw=change(self.battery_kw),
            injection_kw=change(self.injection_kw),
        )


class LiveMarket:
    """One market, slot after slot, with homes that come and go.

    Beside it runs the baseline: the same homes on the same days without demand response, under the conventional rule
    and price.
    """

    def __init__(self, scenario: Scenario, days: Days) -> None:
        self.scenario = scenario
        self.day = -1
        self._days = days
        self._profiles = ProfilesAhead(days, scenario.slots_per_day * max(len(scenario.homes), 1))
        self._profile = Exogenous(*np.zeros((4, 0)))
        self._baseline = BaselineAhead(scenario.slots_per_day, scenario.baseline_buy_price, scenario.soc_reset)
        self.specs: list[HomeSpec] = list(scenario.homes)
        self.homes: tuple[str, ...] = scenario.home_ids
        """Ids of the homes, in the order of all arrays."""
        self.agents: dict[str, slice] = {}
        """Where each prosumer agent's homes stand in the arrays."""
        self.params = scenario.market()
        start = 0
        for agent in scenario.agents:
            self.agents[agent.id] = slice(start, start + len(agent.homes))
            start += len(agent.homes)
        initial = self.params.homes.soc_initial
        self.soc, self.baseline_soc = initial.copy(), initial.copy()
        self.last: LastOutcome | None = None

    # ---------------------------------------------------------------- days and profiles

    def begin_day(self, day: int, slot: int = 0) -> None:
        """Load the profiles of a day, to continue from the given slot; reset the batteries if the scenario says so."""
        self.day = day
        if slot == 0 and self.scenario.soc_reset == "daily":
            initial = self.params.homes.soc_initial
            self.soc, self.baseline_soc = initial.copy(), initial.copy()
        self._load_day()

    def _load_day(self) -> None:
        """Profiles of the homes that are in the market now, and the commands of the conventional rule."""
        self._profile = self._profiles.day(self.day)
        if self.homes != self.scenario.home_ids:
            pv_kw, load_kw = self._days.homes_day(self.specs, self.day)
            self._profile = self._profile._replace(pv_kw=pv_kw, load_kw=load_kw)
        self._command = conventional(self._profile.pv_kw, self._profile.load_kw, self.params.homes)

    def sell_prices(self, day: int) -> list[float]:
        """The posted tariff of a day, one price a slot. [$/kWh]"""
        profile = self._profile if day == self.day else self._days.day(day)
        return [float(price) for price in profile.sell_price]

    def check(self, specs: Sequence[HomeSpec]) -> None:
        """Raise ScenarioError if this market has no profile for one of these homes."""
        self._days.check(specs)

    def profile(self, slot: int) -> Exogenous:
        """PV, loads and tariff of one slot of the present day."""
        return self._profile.slot(slot)

    # ---------------------------------------------------------------- one slot

    def baseline(self, slot: int) -> BaselineSlot:
        """The coming slot without demand response."""
        return self._baseline.slot(self.day, slot, self._profiles_ahead, self.baseline_soc, self.params)

    def _profiles_ahead(self) -> Exogenous:
        """Profiles from the present day on, ``(day, slot, ...)``: many days if the homes are those of the scenario."""
        if self.homes == self.scenario.home_ids:
            return self._profiles.from_day(self.day)
        return self._profile.part(np.newaxis)

    def fallback(self, slot: int) -> Floats:
        """Commands of the conventional rule for homes whose agent does not answer; a copy to write into. [kW]"""
        command: Floats = self._command[slot].copy()
        return command

    def prepare(self, exogenous: Exogenous) -> Prepared:
        """The part of a slot's settlement that does not depend on any action."""
        return prepare(self.soc, exogenous, self.params)

    def settle(self, prepared: Prepared, action: Action) -> Settlement:
        """The settlement of a slot. The market does not change before ``advance``.

        Raises
        ------
        SettlementError
            A number is not finite; names the homes. Nothing of such a slot reaches the journal.
        """
        settled = conclude(prepared, action, self.params)
        if not settled.is_finite:
            wrong = ~np.isfinite(settled.soc + settled.bill)
            homes = ", ".join(np.array(self.homes)[wrong][:10]) or "none"
            raise SettlementError(f"day {self.day}: a settlement is not finite; homes concerned: {homes}")
        return settled

    def advance(self, settled: Settlement, baseline: BaselineSlot) -> None:
        """Continue from a settled slot."""
        self.soc, self.baseline_soc = settled.soc, baseline.soc
        self.last = LastOutcome(
            settled.payment, settled.bill, settled.battery_kw, settled.injection_kw, settled.facility_cost,
            float(settled.demand_kw), float(settled.profit),
        )  # fmt: skip

    def restore(self, specs: Sequence[HomeSpec], agents: dict[str, slice], record: SlotRecord) -> None:
        """Return to the state after a journalled slot."""
        self._set_homes(list(specs), agents)
        self.soc, self.baseline_soc = record.soc.copy(), record.baseline_soc.copy()
        # The same product as in ``settle``, so that what agents see does not depend on where the clock was restarted.
        payment = np.maximum(record.injection_kw, 0.0) * (record.buy_price * self.scenario.dt_h)
        self.last = LastOutcome(
            payment, record.bill, record.battery_kw, record.injection_kw, record.facility_cost,
            record.demand_kw, record.profit,
        )  # fmt: skip

    # ---------------------------------------------------------------- homes that come and go

    def add(self, agent: str, specs: Sequence[HomeSpec]) -> None:
        """Add an agent's homes behind the others."""
        count = len(self.specs)
        self._set_homes([*self.specs, *specs], {**self.agents, agent: slice(count, count + len(specs))})
        initial = self.params.homes.soc_initial[count:]
        self.soc = np.concatenate([self.soc, initial])
        self.baseline_soc = np.concatenate([self.baseline_soc, initial])
        zeros = np.zeros(len(specs))
        if self.last is not None:
            self.last = self.last.with_homes(lambda old: np.concatenate([old, zeros]))
        if self.day >= 0:
            self._load_day()

    def remove(self, agent: str) -> None:
        """Take an agent's homes out."""
        gone = self.agents[agent]
        keep = np.r_[0 : gone.start, gone.stop : len(self.specs)]
        width = gone.stop - gone.start
        agents = {
            name: own if own.start < gone.start else slice(own.start - width, own.stop - width)
            for name, own in self.agents.items()
            if name != agent
        }
        self._set_homes([self.specs[i] for i in keep], agents)
        self.soc, self.baseline_soc = self.soc[keep], self.baseline_soc[keep]
        if self.last is not None:
            self.last = self.last.with_homes(lambda old: old[keep])
        if self.day >= 0:
            self._load_day()

    def _set_homes(self, specs: list[HomeSpec], agents: dict[str, slice]) -> None:
        self.specs, self.agents = specs, agents
        self.homes = tuple(spec.id for spec in specs)
        self.params = self.params.with_homes(homes_params(specs))
        self._baseline.reset()
