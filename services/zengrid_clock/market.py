"""The environment of the live market: its homes, what the day brings them, and the baseline without demand response."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zengrid.core.baselines import conventional
from zengrid.core.home import battery_step
from zengrid.core.settle import Prepared, conclude, prepare, settle
from zengrid.core.state import Action, Exogenous, Settlement
from zengrid.errors import SettlementError
from zengrid.journal.record import BaselineSlot
from zengrid.scenario import homes_params

if TYPE_CHECKING:
    from zengrid.journal import SlotRecord
    from zengrid.scenario import Days, HomeSpec, Scenario

Floats = NDArray[np.float64]


BASELINE_VALUES = 10_000
"""How many slots of the baseline are settled at once: so many values of one column, and no more than there are
profiles."""
DAYS_AHEAD = 32
VALUES_AHEAD = 100_000
"""How many days are generated at once: so many, or so many values of one column, whichever is less."""


NO_BASELINE = BaselineSlot(*np.zeros((4, 0, 0)))


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

    Beside the real market runs its baseline without demand response: the same homes on the same days under the
    conventional rule and price.
    """

    def __init__(self, scenario: Scenario, days: Days) -> None:
        self.scenario = scenario
        self.day, self.slot = -1, 0
        self._days = days
        self._ahead = self._profile = Exogenous(*np.zeros((4, 0)))
        self._ahead_from = 0
        """Its first day."""
        self._baseline = NO_BASELINE
        self._baseline_from = 0, 0
        """The first day and slot that were settled ahead."""
        self.agents: dict[str, slice] = {}
        self.specs: list[HomeSpec] = list(scenario.homes)
        self.homes: tuple[str, ...] = scenario.home_ids
        self.market = scenario.market()
        start = 0
        for agent in scenario.agents:
            self.agents[agent.id] = slice(start, start + len(agent.homes))
            start += len(agent.homes)
        initial = self.market.homes.soc_initial
        self.soc, self.baseline_soc = initial.copy(), initial.copy()
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
            self.soc, self.baseline_soc = initial.copy(), initial.copy()
        self._load_day()

    def _load_day(self) -> None:
        """Profiles of the homes that are there now, and what the conventional rule commands them."""
        if not 0 <= self.day - self._ahead_from < len(self._ahead.pv_kw):
            self._look_ahead()
        self._profile = self._ahead.part(self.day - self._ahead_from)
        if self.homes != self.scenario.home_ids:
            pv_kw, load_kw = self._days.homes_day(self.specs, self.day)
            self._profile = self._profile._replace(pv_kw=pv_kw, load_kw=load_kw)
        self._command = conventional(self._profile.pv_kw, self._profile.load_kw, self.market.homes)

    def _look_ahead(self) -> None:
        """Make some days of the scenario at once: one by one each costs as much as all of them."""
        values = self.slots_per_day * max(len(self.scenario.homes), 1)
        self._ahead = self._days.days(np.arange(self.day, self.day + max(1, min(DAYS_AHEAD, VALUES_AHEAD // values))))
        self._ahead_from = self.day

    def sell_prices(self, day: int) -> list[float]:
        """The posted tariff of a day, one price a slot. [$/kWh]"""
        profile = self._profile if day == self.day else self._days.day(day)
        return [float(price) for price in profile.sell_price]

    def check(self, specs: Sequence[HomeSpec]) -> None:
        """Raise ScenarioError where this market has no profile for one of these homes."""
        self._days.check(specs)

    def profile(self, slot: int) -> Exogenous:
        """PV, loads and tariff of one slot of the current day."""
        return self._profile.slot(slot)

    def baseline(self, slot: int) -> BaselineSlot:
        """The coming slot without demand response."""
        day, within = self.day - self._baseline_from[0], slot - self._baseline_from[1]
        if not (0 <= day < self._baseline.soc.shape[0] and 0 <= within < self._baseline.soc.shape[1]):
            self._settle_baseline(slot)
            day = within = 0
        return BaselineSlot(*(column[day, within] for column in self._baseline))

    def _settle_baseline(self, slot: int) -> None:
        """Settle the baseline from this slot on: it depends on no answer, and many slots cost little more than one."""
        slots = min(self.slots_per_day - slot, max(BASELINE_VALUES // max(len(self.homes), 1), 1))
        days = self._profile.part(np.newaxis)
        if slot == 0 and self.homes == self.scenario.home_ids:
            first = self.day - self._ahead_from
            days = self._ahead.part(slice(first, first + max(BASELINE_VALUES // days.pv_kw.size, 1)))
        ahead = days.part((slice(None), slice(slot, slot + slots)))
        command = conventional(ahead.pv_kw, ahead.load_kw, self.market.homes)
        soc = np.empty_like(command)
        start = np.broadcast_to(self.baseline_soc, command[:, 0].shape)
        # Each round has one day more right, so that after as many rounds as days all of them are.
        for _ in range(len(command)):
            state = start
            for each in range(slots):
                soc[:, each] = state
                _, state = battery_step(state, command[:, each], self.market)
            # Where energy is carried over, a day starts as the one before it has ended; a battery that is full or
            # empty once a day forgets how it started, which ends this sooner.
            carried = start if self.scenario.soc_reset == "daily" else np.concatenate([start[:1], state[:-1]])
            if np.array_equal(carried, start):
                break
            start = carried
        price = np.full(command.shape[:2], self.scenario.baseline_buy_price)
        settled = settle(soc, Action(price, command), ahead, self.market)
        self._baseline = BaselineSlot(settled.soc, settled.bill, settled.profit, settled.facility_kw)
        self._baseline_from = self.day, slot

    def fallback(self, slot: int) -> Floats:
        """Commands for homes whose agent does not answer, from the conventional rule; a copy to write into."""
        command: Floats = self._command[slot].copy()
        return command

    def prepare(self, exogenous: Exogenous) -> Prepared:
        """What of a slot can be settled before anybody has acted."""
        return prepare(self.soc, exogenous, self.market)

    def settle(self, prepared: Prepared, action: Action) -> Settlement:
        """What came of a slot; nothing changes before ``advance``.

        Raises
        ------
        SettlementError
            A number is not finite: names the homes. Nothing of such a slot reaches the journal.
        """
        settled = conclude(prepared, action, self.market)
        if not settled.is_finite:
            wrong = ~np.isfinite(settled.soc + settled.bill)
            homes = ", ".join(np.array(self.homes)[wrong][:10]) or "none"
            raise SettlementError(
                f"slot {self.slot} of day {self.day}: its settlement is not finite; homes concerned: {homes}"
            )
        return settled

    def advance(self, settled: Settlement, baseline: BaselineSlot) -> None:
        """Continue from a settled (and journalled) slot."""
        self.slot += 1
        self.soc, self.baseline_soc = settled.soc, baseline.soc
        self.last = LastSlot(
            settled.payment, settled.bill, settled.battery_kw, settled.injection_kw, settled.facility_cost,
            float(settled.demand_kw), float(settled.profit),
        )  # fmt: skip

    def restore(self, specs: Sequence[HomeSpec], agents: dict[str, slice], record: SlotRecord) -> None:
        """Go back to the state that a journal ends with."""
        self._set_homes(list(specs), agents)
        self.soc, self.baseline_soc = record.soc.copy(), record.baseline_soc.copy()
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
        self.baseline_soc = np.concatenate([self.baseline_soc, initial])
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
        self.soc, self.baseline_soc = self.soc[keep], self.baseline_soc[keep]
        if self.last is not None:
            self.last = self.last.with_homes(lambda old: old[keep])
        if self.day >= 0:
            self._load_day()

    def _set_homes(self, specs: list[HomeSpec], agents: dict[str, slice]) -> None:
        self.specs, self.agents = specs, agents
        self.homes = tuple(spec.id for spec in specs)
        self.market = self.market.with_homes(homes_params(specs))
        self._baseline = NO_BASELINE
