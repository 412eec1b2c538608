"""One network for homes of any size: trained on drawn homes, each in a market of its own kind of prices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from zengrid.core.levels import level_fractions, to_commands
from zengrid.core.observe import ObservationKind
from zengrid.core.state import Exogenous
from zengrid.env.facts import market_facts
from zengrid.env.vector import VectorMarket, beside, pick, slots_first
from zengrid.learn.dqn import DQN, Stack
from zengrid.learn.own_model import BUY_PRICE, SOC
from zengrid.learn.scaling import Scaling
from zengrid.learn.settings import FOLLOWER, Learning
from zengrid.policy.file import Layer, PolicyFile
from zengrid.policy.network import GridNetwork
from zengrid.policy.relative import Relative, relative_features
from zengrid.scenario import Days, Scenario
from zengrid.scenario.home_spec import HomeSpec

Floats = NDArray[np.float64]
KIND: ObservationKind = "public"

PRICES: tuple[Literal["grid", "schedule", "constant"], ...] = ("grid", "constant", "schedule")
"""Who sets the price, market after market: the trained grid agent in every third."""

LARGEST = {"battery_h": 12.0, "pv_per_kw": 5.0, "pv_kw": 4.0, "load_kw": 3.0}
"""What counts as large, in units of the battery's power."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Generic:
    """How the policy for homes of any size is trained."""

    learning: Learning
    markets: int = 96
    """Markets side by side, each with as many drawn homes as the scenario has."""
    days: int = 1
    """Days that each of them lives through side by side."""
    pool: int = 32
    """Days of each market to draw from."""
    steps: int = 6_000
    warmup: int = 48

    @classmethod
    def default(cls) -> Generic:
        """What the policy that comes with zengrid was trained by."""
        return cls(learning=replace(FOLLOWER, batch=1024, soft_target=0.02, memory=300_000, average=0.999))


def draw_home(name: str, profiles: tuple[str, ...], rng: np.random.Generator) -> HomeSpec:
    """A home of any size: 0 to 10 kW of PV, 2 to 25 kWh, a third to three times the scenario's consumption."""
    capacity_kwh = float(np.exp(rng.uniform(np.log(2.0), np.log(25.0))))
    # From a tenth of an hour to some hours for a full charge is seldom; most batteries take 2 to 6 h.
    power_kw = float(np.clip(capacity_kwh / rng.uniform(1.6, 7.0), 0.5, 10.0))
    efficiency = float(rng.choice([1.0, 1.0, 0.98, 0.96, 0.94]))
    return HomeSpec.model_validate(
        {
            "id": name,
            "pv_kw": float(rng.choice([0.0, *rng.uniform(1.0, 10.0, 9)])),
            "battery": {
                "capacity_kwh": capacity_kwh,
                "charge_max_kw": power_kw,
                "discharge_max_kw": power_kw,
                "charge_efficiency": efficiency,
                "discharge_efficiency": efficiency,
            },
            "injection_max_kw": 30.0,
            "load": {"profile": str(rng.choice(profiles)), "scale": float(np.exp(rng.uniform(-1.1, 1.1)))},
            "seed": int(rng.integers(2**31)),
        }
    )


def drawn_market(scenario: Scenario, rng: np.random.Generator) -> Scenario:
    """The scenario with homes of any size instead of its own."""
    profiles = tuple(home.load.profile or "" for home in scenario.homes)
    homes = [draw_home(home.id, profiles, rng).model_dump() for home in scenario.homes]
    return scenario.with_(homes=homes, soc_reset="never")


class AnyHome:
    """What homes know about themselves, read from what a network for all of them sees: as ``OwnModel``, in relative
    units. A reward of one is full battery power for a slot at the highest price.
    """

    def __init__(self, levels: int, dt_h: float, scaling: Scaling, dearest: float) -> None:
        features = relative_features(KIND)
        self._hours, self._efficiency = features.index("battery_h"), features.index("efficiency")
        self.fractions = torch.as_tensor(level_fractions(levels), dtype=torch.float32)
        self.offset = torch.as_tensor(scaling.offset, dtype=torch.float32)
        self.scale = torch.as_tensor(scaling.scale, dtype=torch.float32)
        self.dt_h, self.money = dt_h, 1.0 / dearest
        self.middle = float(scaling.offset[BUY_PRICE]) / (dearest * dt_h)

    def _facts(self, seen: Tensor) -> Tensor:
        return seen / self.scale + self.offset

    def any_charge(self, seen: Tensor, generator: torch.Generator) -> Tensor:
        """The same observations with the battery at any permitted state of charge."""
        soc = torch.rand((*seen.shape[:-1], 1), generator=generator)
        return torch.cat([(soc - self.offset[SOC]) * self.scale[SOC], seen[..., 1:]], dim=-1)

    def outcomes(self, seen: Tensor, sell_price: Tensor, seen_next: Tensor) -> tuple[Tensor, Tensor]:
        """What each command would have brought, ``(network, row, action)`` and with ``feature`` behind."""
        facts = self._facts(seen)
        soc, pv, load, buy_price = (facts[..., place : place + 1] for place in range(BUY_PRICE + 1))
        hours = facts[..., self._hours, None].clamp(min=1e-3)
        # Losses of charging and discharging are alike: only their product is told.
        one_way = facts[..., self._efficiency, None].clamp(min=1e-3).sqrt()
        room, stored = (1.0 - soc) * hours / (one_way * self.dt_h), soc * hours * one_way / self.dt_h
        power = torch.maximum(torch.minimum(self.fractions.expand(*soc.shape[:-1], -1), room), -stored)
        gained_h = (power.clamp(min=0.0) * one_way + power.clamp(max=0.0) / one_way) * self.dt_h
        injection = pv - load - power
        price = torch.where(injection > 0.0, buy_price, sell_price[..., None])
        after = seen_next[..., None, :].expand(*power.shape, seen_next.shape[-1]).clone()
        after[..., SOC] = (soc + gained_h / hours - self.offset[SOC]) * self.scale[SOC]
        return injection * price * self.money, after

    def stored_value(self, seen: Tensor) -> Tensor:
        """What the stored energy would earn at the middle price."""
        facts = self._facts(seen)
        return (
            facts[..., SOC]
            * facts[..., self._hours]
            * facts[..., self._efficiency].clamp(min=1e-3).sqrt()
            * (self.middle)
        )


class GenericTraining:
    """Trains a network for homes of any size under a trained grid agent's prices, and under others.

    Parameters
    ----------
    scenario:
        Whose days, loads, tariff and facilities there are.
    grid:
        The trained grid agent.
    settings:
        How to train.
    seed:
        Decides all that is random.
    """

    def __init__(self, scenario: Scenario, grid: PolicyFile, settings: Generic, seed: int) -> None:
        self.scenario, self.settings, self.seed = scenario, settings, seed
        self.step = 0
        self._rng = np.random.default_rng(seed)
        self._generator = torch.Generator().manual_seed(seed)
        scenarios = [drawn_market(scenario, self._rng) for _ in range(settings.markets)]
        self._pools = [slots_first(Days(s).days(Days(s).training(settings.pool))) for s in scenarios]
        self.buy_prices = np.array(scenario.buy_prices)
        self.vector = VectorMarket(
            beside([s.market() for s in scenarios]), (settings.markets, settings.days), self.buy_prices
        )
        self._grid = GridNetwork(grid, market_facts(scenario))
        self._kind = np.array([PRICES.index(PRICES[i % len(PRICES)]) for i in range(settings.markets)])
        relative = [Relative.of(KIND, s.market().homes, np.array([home.pv_kw for home in s.homes])) for s in scenarios]
        self._relative = Relative(*(np.stack(parts)[:, None] for parts in zip(*relative, strict=True)))
        self._fractions = level_fractions(scenario.battery_levels)
        self.scaling = self._scales()
        model: Any = AnyHome(
            scenario.battery_levels, scenario.dt_h, self.scaling, max(*self.buy_prices, *scenario.sell_prices)
        )
        features = relative_features(KIND)
        rows = settings.markets * settings.days * len(scenario.homes)
        self.dqn = DQN(
            Stack(1, rows, len(features), scenario.battery_levels), settings.learning, self._generator,
            features.index("time_sin"), model,
        )  # fmt: skip

    def _scales(self) -> Scaling:
        prices = float(self.buy_prices[0]), float(self.buy_prices[-1])
        tariff = min(self.scenario.sell_prices), max(self.scenario.sell_prices)
        ranges = {
            "soc": (0.0, 1.0), "buy_price": prices, "time_sin": (-1.0, 1.0), "time_cos": (-1.0, 1.0),
            "sell_price": tariff, "efficiency": (0.85, 1.0), **{name: (0.0, most) for name, most in LARGEST.items()},
        }  # fmt: skip
        return Scaling.between(relative_features(KIND), ranges)

    def train(self, report: Callable[[float], None] = lambda progress: None) -> None:
        """Train to the end; ``report`` is told how far it is, 0 to 1, once a day."""
        while self.step < self.settings.steps:
            self._day()
            report(min(self.step / self.settings.steps, 1.0))

    def _day(self) -> None:
        settings, vector = self.settings, self.vector
        numbers = self._rng.integers(settings.pool, size=(settings.markets, settings.days))
        chosen = [pick(pool, index) for pool, index in zip(self._pools, numbers, strict=True)]
        vector.begin(
            Exogenous(*(np.stack(columns, axis=1) for columns in zip(*chosen, strict=True))),
            None if self.step else vector.market.homes.soc_initial,
        )
        self._other_prices = self._draw_prices()
        while not vector.over:
            self._slot()
            self.step += 1

    def _draw_prices(self) -> Floats:
        """Prices of those markets whose grid agent is not the trained one, ``(slot, market, day)``. [$/kWh]"""
        slots, lead = self.scenario.slots_per_day, self.vector.lead
        constant = self._rng.choice(self.buy_prices, size=lead)
        # The price without demand response is the one that most markets have.
        constant = np.where(self._rng.random(lead) < 0.5, self.scenario.baseline_buy_price, constant)
        rises = self._rng.uniform(14.0, 20.0, lead) / self.scenario.dt_h
        falls = rises + self._rng.uniform(2.0, 6.0, lead) / self.scenario.dt_h
        dear = self._rng.choice(self.buy_prices, size=lead)
        slot = np.arange(slots)[:, None, None]
        schedule = np.where((slot >= rises) & (slot < falls), np.maximum(dear, constant), np.minimum(dear, constant))
        is_constant = np.array([PRICES[kind] == "constant" for kind in self._kind])
        return np.where(is_constant[:, None], constant, schedule)

    def _slot(self) -> None:
        vector = self.vector
        progress = self.step / self.settings.steps
        by_grid = np.array([PRICES[kind] == "grid" for kind in self._kind])[:, None]
        buy_price = np.where(by_grid, self._grid.act(vector.grid_view()), self._other_prices[vector.slot])
        observation = vector.prosumer_observation(KIND, buy_price)
        seen = torch.from_numpy(self.scaling(self._relative(observation)).reshape(1, -1, self.scaling.offset.size))
        level = self.dqn.act(seen, self.settings.learning.epsilon(progress))
        fraction = self._fractions[level.numpy().reshape(observation.shape[:-1])]
        command_kw = to_commands(fraction, vector.market.homes)
        sell_price = float(vector.now.sell_price.flat[0])
        vector.step(buy_price, command_kw)
        # What it was paid does not matter: the value of every command is computed from what was seen.
        self.dqn.replay.add(seen, level, torch.zeros(level.shape), sell_price, True)
        if self.step >= self.settings.warmup:
            self.dqn.learn(progress)

    def file(self, notes: Mapping[str, Any]) -> PolicyFile:
        """The policy, as it is now."""
        weights = [weight.detach().numpy()[0] for weight in self.dqn.averaged]
        layers = zip(weights[::2], weights[1::2], strict=True)
        return PolicyFile(
            role="prosumer",
            observation=KIND,
            features=relative_features(KIND),
            offset=self.scaling.offset,
            scale=self.scaling.scale,
            levels=level_fractions(self.scenario.battery_levels),
            activation=self.settings.learning.activation,
            layers=tuple(Layer(np.ascontiguousarray(weight.T), bias[0].copy()) for weight, bias in layers),
            dt_h=self.scenario.dt_h,
            name="generic",
            training={"scenario": self.scenario.name, "seed": self.seed, "steps": self.step, **notes},
            relative=True,
        )
