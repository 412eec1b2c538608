"""Training: markets side by side, one learner for every agent of each, slot after slot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from zengrid.core.levels import level_commands, level_fractions
from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.core.settle import total
from zengrid.core.state import Exogenous, Settlement
from zengrid.env.vector import VectorMarket, beside, pick, slots_first
from zengrid.errors import PolicyError
from zengrid.learn.checkpoint import (
    Count,
    NumpyGenerator,
    State,
    Values,
    check,
    check_generator,
    part,
    shapes,
    under,
    within,
)
from zengrid.learn.dqn import DQN, Counts, Stack, check_learners, learner_shapes
from zengrid.learn.evaluation import Trained
from zengrid.learn.own_model import OwnModel, repeat_homes
from zengrid.learn.scaling import Scaling, scales
from zengrid.learn.settings import Settings
from zengrid.policy.file import Layer, PolicyFile
from zengrid.policy.tensor_file import Shape
from zengrid.scenario import Days, Scenario

Floats = NDArray[np.float64]
Which = Literal["averaged", "online"]


class Earned(NamedTuple):
    """What a day of training came to, random actions included: means over the days played side by side."""

    bill: Floats
    """(market, home) [$]"""
    profit: Floats
    """(market,) [$]"""
    reserve_kwh: Floats
    """(market,) energy of all facilities but the first [kWh]"""


class Progress(Values):
    """How far a training is."""

    step: Count
    grid: Counts
    prosumers: Counts
    rng: NumpyGenerator


class Training:
    """Several markets trained at once: seeds of a scenario, variants of it, or both.

    Parameters
    ----------
    scenarios:
        One for each market. They may differ in their homes, as far as their number and the profiles allow.
    seeds:
        One for each market. Together they decide everything that is random: the same list gives the same result.
    settings:
        How to learn.
    observation:
        What agents see.
    device:
        Where the networks are.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        seeds: Sequence[int],
        settings: Settings,
        observation: ObservationKind = "public",
        device: str = "cpu",
    ) -> None:
        first = scenarios[0]
        for other in scenarios[1:]:
            for name in ("slot_minutes", "tariff", "buy_prices", "battery_levels", "soc_reset"):
                if getattr(other, name) != getattr(first, name):
                    raise PolicyError(f"{name}: markets trained side by side must have the same")
            for name in ("homes", "facilities", "consumers"):
                if len(getattr(other, name)) != len(getattr(first, name)):
                    raise PolicyError(f"number of {name}: markets trained side by side must have the same")
        self.scenarios, self.seeds, self.settings, self.observation = scenarios, tuple(seeds), settings, observation
        self.device = torch.device(device)
        markets, homes = [scenario.market() for scenario in scenarios], len(first.homes)
        self.lead = (len(markets), settings.days)
        self.buy_prices = np.array(first.buy_prices)
        self.vector = VectorMarket(beside(markets), self.lead, self.buy_prices)
        # Variants share their days unless something that makes them differs.
        pools = {id(scenario): scenario for scenario in scenarios}
        made = {key: _pool(scenario, settings.pool) for key, scenario in pools.items()}
        self._pools = [made[id(scenario)] for scenario in scenarios]
        everything = Exogenous(*(np.concatenate(columns, axis=1) for columns in zip(*made.values(), strict=True)))
        self.scales = scales(observation, self.vector.market, everything, self.buy_prices)
        all_homes = repeat_homes([market.homes for market in markets])
        commands = level_commands(first.battery_levels, all_homes)
        self._commands_kw = np.moveaxis(commands.reshape(-1, len(markets), homes), 0, -1)  # (market, home, level)
        draw = np.random.SeedSequence([len(seeds), *seeds])
        self._rng = np.random.default_rng(draw)
        self._generator = torch.Generator(self.device).manual_seed(int(draw.generate_state(1)[0]))
        model = OwnModel(
            all_homes, first.battery_levels, first.dt_h, self.scales.prosumer, self.scales.prosumer_reward, self.device
        )
        self.features = _features(first, observation)
        self.grid, self.prosumers = (
            DQN(stack, learning, self._generator, self._clock(features), own)
            for stack, learning, features, own in zip(
                stacks(scenarios, settings, observation), (settings.grid, settings.prosumer), self.features,
                (None, model), strict=True,
            )
        )  # fmt: skip
        self._dt_h = first.dt_h
        self._carries = first.soc_reset == "never"
        self.step = 0
        self.loss = (0.0, 0.0)

    def _clock(self, features: Sequence[str]) -> int | None:
        """Where networks see the time of day, if they shall begin with a clock."""
        return features.index("time_sin") if "time_sin" in features and self.settings.clock else None

    @property
    def done(self) -> bool:
        """Whether all steps are taken."""
        return self.step >= self.settings.steps

    @property
    def progress(self) -> float:
        """How far it is, 0 to 1."""
        return self.step / self.settings.steps

    def day(self) -> Earned:
        """One day of all markets; returns what it came to."""
        numbers = self._rng.integers(self.settings.pool, size=self.lead)
        chosen = [pick(pool, index) for pool, index in zip(self._pools, numbers, strict=True)]
        profile = Exogenous(*(np.stack(columns, axis=1) for columns in zip(*chosen, strict=True)))
        soc = None if self._carries and self.step else self.vector.market.homes.soc_initial
        self.vector.begin(profile, soc)
        settled = []
        while not self.vector.over:
            settled.append(self.slot())
            self.step += 1
        return Earned(
            np.sum([slot.bill for slot in settled], axis=0).mean(axis=1),
            np.sum([slot.profit for slot in settled], axis=0).mean(axis=1),
            np.sum([total(slot.facility_kw[..., 1:]) for slot in settled], axis=0).mean(axis=1) * self._dt_h,
        )

    def slot(self) -> Settlement:
        """One slot: the grids set prices, the prosumers answer, the markets settle; then everybody learns."""
        vector, settings = self.vector, self.settings
        kind, (markets, days) = self.observation, self.lead
        seen_grid = self._tensor(self.scales.grid(vector.grid_observation(kind)))
        price_level = self.grid.act(seen_grid, settings.grid.epsilon(self.progress))
        buy_price = self.buy_prices[price_level.cpu().numpy()]
        seen_homes = self._by_home(self.scales.prosumer(vector.prosumer_observation(kind, buy_price)))
        level = self.prosumers.act(seen_homes, settings.prosumer.epsilon(self.progress))
        command_kw = np.take_along_axis(self._commands_kw, level.cpu().numpy().reshape(markets, -1, days), axis=-1)

        sell_price = float(vector.now.sell_price.flat[0])
        settled = vector.step(buy_price, np.ascontiguousarray(np.swapaxes(command_kw, 1, 2)))
        goes_on = self._carries or not vector.over

        profit = self._tensor(settled.profit * self.scales.grid_reward)
        saved = self._by_home(settled.bill[..., None] * -self.scales.prosumer_reward)[..., 0]
        self.grid.replay.add(seen_grid, price_level, profit, sell_price, goes_on)
        self.prosumers.replay.add(seen_homes, level, saved, sell_price, goes_on)
        if self.step >= settings.warmup:
            for learners, learning in ((self.grid, settings.grid), (self.prosumers, settings.prosumer)):
                if self.step % learning.every == 0:
                    for _ in range(learning.updates):
                        learners.learn(self.progress)
        return settled

    def _tensor(self, values: Floats | NDArray[np.float32]) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self.device)

    def _by_home(self, values: Floats | NDArray[np.float32]) -> Tensor:
        """``(market, day, home, ...)`` -> ``(market x home, day, ...)``, a row for each network."""
        turned = np.ascontiguousarray(np.swapaxes(values, 1, 2), dtype=np.float32)
        return torch.from_numpy(turned.reshape(-1, *turned.shape[2:])).to(self.device)

    def trained(self, which: Which = "averaged", notes: Mapping[str, Any] | None = None) -> list[Trained]:
        """Policy files of every market, as they are now.

        Parameters
        ----------
        which:
            The running average of the weights, or the last ones.
        notes:
            What else to write down about how they were made.
        """
        grid_levels, home_levels = self.buy_prices, level_fractions(self.scenarios[0].battery_levels)
        found = []
        for place, (scenario, seed) in enumerate(zip(self.scenarios, self.seeds, strict=True)):
            made = {"scenario": scenario.name, "seed": seed, "steps": self.step, **(notes or {})}
            homes = scenario.home_ids
            own = range(place * len(homes), (place + 1) * len(homes))
            grid = self._file("grid", scenario, self.grid, which, [place], grid_levels, (), made)
            found.append(
                Trained(grid, self._file("prosumer", scenario, self.prosumers, which, own, home_levels, homes, made))
            )
        return found

    def _file(
        self, role: Literal["grid", "prosumer"], scenario: Scenario, learners: DQN, which: Which,
        networks: Sequence[int], levels: Floats, homes: tuple[str, ...], notes: Mapping[str, Any],
    ) -> PolicyFile:  # fmt: skip
        weights = [w.detach().cpu().numpy()[list(networks)] for w in getattr(learners, which)]
        layers = []
        for weight, bias in zip(weights[::2], weights[1::2], strict=True):
            turned = np.ascontiguousarray(np.swapaxes(weight, -1, -2))
            layers.append(Layer(turned, bias[:, 0]) if homes else Layer(turned[0], bias[0, 0]))
        scaling: Scaling = self.scales.prosumer if homes else self.scales.grid
        return PolicyFile(
            role=role,
            observation=self.observation,
            features=self.features[1] if homes else self.features[0],
            offset=scaling.offset,
            scale=scaling.scale,
            levels=levels,
            activation=learners.learning.activation,
            layers=tuple(layers),
            dt_h=scenario.dt_h,
            name=f"{scenario.name}-{role}",
            homes=homes,
            training=notes,
        )

    def state(self) -> State[Progress]:
        """Everything that ``restore`` needs to go on exactly; taken between days."""
        grid, prosumers = self.grid.state(), self.prosumers.state()
        market = {name: torch.from_numpy(value.copy()) for name, value in self.vector.memory().items()}
        return State(
            Progress(step=self.step, grid=grid.values, prosumers=prosumers.values, rng=NumpyGenerator.of(self._rng)),
            {
                "generator": self._generator.get_state(), **under("market", market),
                **under("grid", grid.tensors), **under("prosumers", prosumers.tensors),
            },
        )  # fmt: skip

    def restore(self, state: State[Progress]) -> None:
        """Go back to a state, of a training with the same arguments.

        Raises
        ------
        PolicyError
            Where no such training can have left it behind; then nothing has changed.
        """
        values, tensors = state
        slots = self.scenarios[0].slots_per_day
        if values.step > self.settings.steps + slots or values.step % slots:
            raise PolicyError(f"step = {values.step}: permitted are whole days of {slots} slots")
        check(tensors, training_shapes(self.scenarios, self.settings, self.observation, self.device))
        within("market.soc", tensors, 0.0, 1.0)
        check_learners("grid", tensors, self.grid.actions)
        check_learners("prosumers", tensors, self.prosumers.actions)
        check_generator(tensors["generator"], self._generator)
        self.grid.restore(State(values.grid, part("grid", tensors)))
        self.prosumers.restore(State(values.prosumers, part("prosumers", tensors)))
        self.step, self._rng = values.step, values.rng.made()
        self._generator.set_state(tensors["generator"])
        self.vector.remember({name: value.numpy() for name, value in part("market", tensors).items()})


def stacks(scenarios: Sequence[Scenario], settings: Settings, observation: ObservationKind) -> tuple[Stack, Stack]:
    """The sizes of both stacks of learners: grid agents, and prosumers."""
    first, markets = scenarios[0], len(scenarios)
    grid, prosumer = _features(first, observation)
    return (
        Stack(markets, settings.days, len(grid), len(first.buy_prices)),
        Stack(markets * len(first.homes), settings.days, len(prosumer), first.battery_levels),
    )


def training_shapes(
    scenarios: Sequence[Scenario], settings: Settings, observation: ObservationKind, device: torch.device
) -> dict[str, Shape]:
    """Type and size of every array of a training: what takes memory is known before there is any of it."""
    first, lead = scenarios[0], (len(scenarios), settings.days)
    grid, prosumers = stacks(scenarios, settings, observation)
    market = {"soc": len(first.homes), "facility_cost": len(first.facilities), "payment": len(first.homes)}
    return {
        "generator": shapes({"": torch.Generator(device).get_state()})[""],
        **{f"market.{name}": Shape("float64", (*lead, count)) for name, count in market.items()},
        "market.demand_kw": Shape("float64", lead),
        **under("grid", learner_shapes(grid, settings.grid)),
        **under("prosumers", learner_shapes(prosumers, settings.prosumer)),
    }


def _features(scenario: Scenario, observation: ObservationKind) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What grid agents and prosumers see."""
    grid = grid_features(observation, len(scenario.facilities), len(scenario.homes))
    return grid, prosumer_features(observation)


def _pool(scenario: Scenario, count: int) -> Exogenous:
    days = Days(scenario)
    return slots_first(days.days(days.training(count)))
