"""One home of the scenario ``paper`` for Gymnasium, in plain Python numbers: as cheap as an environment can be.

It follows the battery, meter and bill of zengrid's core (``zengrid.core.home_physics``, ``zengrid.core.settle``) for
one home with a lossless battery under a price schedule; ``check_bills`` plays random actions in both and compares the
bills.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from agent_rules import BUY_PRICES
from zengrid.core.levels import level_commands
from zengrid.env.vector import VectorMarket
from zengrid.scenario import Days, load

DAYS = 64
CHECKED_DAYS = 16
LARGEST_DEVIATION = 1e-12
"""Of a bill from zengrid's core: both sum the same numbers in another order. [$]"""


class HomeEnv(gymnasium.Env):
    """A home that saves on its bill: 4 numbers observed, 5 battery levels, an episode a day.

    Observations: state of charge [-], PV [kW], load [kW], price at which the grid buys [10 $/kWh].
    Reward: minus the bill of the slot. [$]
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - Gymnasium's
    render_mode = None

    def __init__(self) -> None:
        scenario = load("paper")
        homes, self.dt_h = scenario.market().homes, scenario.dt_h
        days = Days(scenario).days(Days(scenario).training(DAYS))
        self.pv_kw: list[list[float]] = days.pv_kw[:, :, 0].tolist()
        self.load_kw: list[list[float]] = days.load_kw[:, :, 0].tolist()
        self.sell_price: list[list[float]] = days.sell_price.tolist()
        self.commands_kw: list[float] = level_commands(scenario.battery_levels, homes)[:, 0].tolist()
        self.capacity_kwh, self.soc_initial = float(homes.capacity_kwh[0]), float(homes.soc_initial[0])
        self.soc_min, self.soc_max = float(homes.soc_min[0]), float(homes.soc_max[0])
        self.slots = scenario.slots_per_day
        self.day = -1
        self.observation_space = gymnasium.spaces.Box(-1.0, 10.0, (4,), np.float32)
        self.action_space = gymnasium.spaces.Discrete(len(self.commands_kw))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray[Any, Any], dict[str, Any]]:
        """Begin the next of the days."""
        super().reset(seed=seed)
        self.day = (self.day + 1) % DAYS
        self.slot, self.soc = 0, self.soc_initial
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray[Any, Any], float, bool, bool, dict[str, Any]]:
        """Settle a slot; a day ends by truncation, since the next one goes on like it."""
        reach_kw = self.capacity_kwh / self.dt_h
        lowest_kw, highest_kw = (self.soc_min - self.soc) * reach_kw, (self.soc_max - self.soc) * reach_kw
        battery_kw = min(max(self.commands_kw[action], lowest_kw), highest_kw)
        self.soc = min(max(self.soc + battery_kw / reach_kw, self.soc_min), self.soc_max)
        injection_kw = self.pv_kw[self.day][self.slot] - self.load_kw[self.day][self.slot] - battery_kw
        price = BUY_PRICES[self.slot] if injection_kw > 0.0 else self.sell_price[self.day][self.slot]
        self.slot += 1
        return self._observe(), injection_kw * price * self.dt_h, False, self.slot == self.slots, {}

    def _observe(self) -> np.ndarray[Any, Any]:
        slot = min(self.slot, self.slots - 1)
        values = (self.soc, self.pv_kw[self.day][slot], self.load_kw[self.day][slot], 10.0 * BUY_PRICES[slot])
        return np.array(values, np.float32)


def check_bills() -> str:
    """Play random actions here and in zengrid's core; exits where a bill differs by more than rounding.

    Returns
    -------
    A sentence to print.
    """
    scenario, env, rng = load("paper"), HomeEnv(), np.random.default_rng(0)
    market, days = VectorMarket(scenario.market()), Days(scenario)
    commands_kw = level_commands(scenario.battery_levels, scenario.market().homes)
    largest = 0.0
    for number in days.training(DAYS)[:CHECKED_DAYS]:
        env.reset()
        market.begin(days.day(int(number)), market.market.homes.soc_initial)
        while not market.over:
            action, price = int(rng.integers(len(commands_kw))), BUY_PRICES[market.slot]
            settled = market.step(price, commands_kw[action])
            largest = max(largest, abs(float(settled.bill[0]) + env.step(action)[1]))
    if largest > LARGEST_DEVIATION:
        raise SystemExit(f"a bill differs from that of zengrid's core by {largest} $; allowed is {LARGEST_DEVIATION}")
    return f"{CHECKED_DAYS} days of random actions: bills equal zengrid's core to rounding ({largest:.0e} $)"
