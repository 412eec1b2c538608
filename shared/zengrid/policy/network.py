"""Policies that were trained: a network from a policy file, evaluated with numpy."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from zengrid.core.levels import to_commands
from zengrid.core.observe import (
    ObservationKind,
    grid_features,
    observe_grid,
    observe_prosumers,
    prosumer_features,
    time_features,
)
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.file import Layer, PolicyFile, Role
from zengrid.policy.prices import price_level
from zengrid.policy.relative import Relative
from zengrid.policy.views import GridView, ProsumerView

Floats = NDArray[np.float64]


class Network:
    """The network of a policy file, in float64.

    Parameters
    ----------
    homes:
        Whose networks to take, in that order, where each home has its own; otherwise without effect.
    """

    def __init__(self, file: PolicyFile, homes: tuple[str, ...] = ()) -> None:
        if file.homes:
            strangers = [home for home in homes if home not in file.homes]
            if strangers:
                raise PolicyError(f"home {strangers[0]}: the file has networks for {', '.join(file.homes)}")
            rows = [file.homes.index(home) for home in homes]
            layers = [Layer(layer.weight[rows], layer.bias[rows]) for layer in file.layers]
        else:
            layers = list(file.layers)
        self._own = bool(file.homes)
        self._offset, self._scale = file.offset, file.scale
        self._activation = np.tanh if file.activation == "tanh" else _relu
        self.renew(layers)

    def renew(self, layers: Sequence[Layer]) -> None:
        """Take other weights of the same shape, for the same observations."""
        weights = [layer.weight.astype(np.float64) for layer in layers]
        # Each home's network is applied to a matrix with a row for every market side by side.
        biases = [(layer.bias[:, None] if self._own else layer.bias).astype(np.float64) for layer in layers]
        # The scaling of observations becomes part of the first layer.
        weights[0] = weights[0] * self._scale
        turned = [np.ascontiguousarray(np.swapaxes(weight, -1, -2)) for weight in weights]
        biases[0] = biases[0] - (self._offset[None, :] if self._own else self._offset) @ turned[0]
        *self._hidden, self._output = zip(turned, biases, strict=True)

    def q_values(self, observation: Floats) -> Floats:
        """What each level is worth, ``(..., feature)`` -> ``(..., level)``; own networks need the axis of homes."""
        lead = observation.shape[:-1]
        # As few and as large products as possible: one for all rows, or one for each home.
        if self._own:
            values = observation.reshape(-1, *observation.shape[-2:]).swapaxes(0, 1)
        else:
            values = observation.reshape(-1, observation.shape[-1])
        for weight, bias in self._hidden:
            values = self._activation(values @ weight + bias)
        weight, bias = self._output
        values = values @ weight + bias
        if self._own:
            values = values.swapaxes(0, 1)
        return values.reshape(*lead, values.shape[-1])


def _relu(values: Floats) -> Floats:
    positive: Floats = np.maximum(values, 0.0)
    return positive


def greedy(q_values: Floats) -> NDArray[np.intp]:
    """Position of the best level, ``(...)``; of equally good ones the first.

    Compared as float32, which is how networks are trained: products of matrices round differently for one row and for
    many, and the choice must not.
    """
    level: NDArray[np.intp] = q_values.astype(np.float32).argmax(axis=-1)
    return level


class ProsumerNetwork:
    """Commands batteries as a network says; one network for all homes, or one for each.

    Raises
    ------
    PolicyError
        Where the file does not fit the market.
    """

    def __init__(self, file: PolicyFile, facts: MarketFacts) -> None:
        _check(file, "prosumer", facts)
        self.name, self.version = file.name, file.version
        self.features = prosumer_features(file.observation)
        self.levels = to_commands(file.levels[:, None], facts.homes)[:, 0] if facts.home_ids else file.levels
        """What the Q-values stand for, for the first home. [kW]"""
        self._kind = file.observation
        self._fractions = file.levels
        self._network = Network(file, facts.home_ids)
        self._first = Network(file, facts.home_ids[:1]) if file.homes else self._network
        self._relative = None
        if file.relative:
            if len(facts.pv_kw) != len(facts.home_ids):
                raise PolicyError("pv_kw: this policy needs the rated PV power of each home")
            self._relative = Relative.of(file.observation, facts.homes, np.array(facts.pv_kw))

    @classmethod
    def load(cls, path: Path | str, facts: MarketFacts) -> Self:
        """The policy in a file, for a market."""
        file = PolicyFile.load(path)
        try:
            return cls(file, facts)
        except PolicyError as error:
            raise PolicyError(f"policy file {path}: {error}") from None

    def act(self, view: ProsumerView) -> Floats:
        """Commands, ``(..., home)``. [kW]"""
        observation = prosumer_observation(self._kind, view)
        if self._relative is not None:
            observation = self._relative(observation)
        return to_commands(self._fractions[greedy(self._network.q_values(observation))], view.homes)

    def q_values(self, observation: Floats) -> Floats:
        """What each level is worth to the first home in so many situations, ``(row, feature)`` -> ``(row, level)``."""
        observation = observation[:, None, :]
        if self._relative is not None:
            observation = self._relative.first()(observation)
        return self._first.q_values(observation)[:, 0]


class GridNetwork:
    """Sets the buy price as a network says.

    Raises
    ------
    PolicyError
        Where the file does not fit the market.
    """

    def __init__(self, file: PolicyFile, facts: MarketFacts) -> None:
        _check(file, "grid", facts)
        self.name, self.version = file.name, file.version
        self.features = file.features
        self.levels = np.array([price_level(level, facts.buy_prices) for level in file.levels.tolist()])
        """What the Q-values stand for. [$/kWh]"""
        self._kind = file.observation
        self._network = Network(file)

    @classmethod
    def load(cls, path: Path | str, facts: MarketFacts) -> Self:
        """The policy in a file, for a market."""
        file = PolicyFile.load(path)
        try:
            return cls(file, facts)
        except PolicyError as error:
            raise PolicyError(f"policy file {path}: {error}") from None

    def act(self, view: GridView) -> Floats:
        """The price, ``(...)``. [$/kWh]"""
        price: Floats = self.levels[greedy(self._network.q_values(self._observe(view)))]
        return price

    def q_values(self, observation: Floats) -> Floats:
        """What each level is worth, ``(..., feature)`` -> ``(..., level)``."""
        return self._network.q_values(observation)

    def _observe(self, view: GridView) -> Floats:
        observation = grid_observation(self._kind, view)
        if observation.shape[-1] != len(self.features):
            raise PolicyError(
                f"observation has {observation.shape[-1]} numbers, with payments of {view.homes} homes: "
                f"the policy was trained on {len(self.features)} ({', '.join(self.features)})"
            )
        return observation


def prosumer_observation(kind: ObservationKind, view: ProsumerView) -> Floats:
    """What networks see of a slot, ``(..., home, feature)``."""
    return observe_prosumers(
        kind, view.soc, view.pv_kw, view.load_kw, view.buy_price, view.sell_price, time_features(view.slot, view.dt_h)
    )


def grid_observation(kind: ObservationKind, view: GridView) -> Floats:
    """What networks see of a slot, ``(..., feature)``; raises PolicyError where the view does not have it."""
    time = time_features(view.slot, view.dt_h)
    demand_kw, sell_price = np.asarray(view.demand_kw), np.asarray(view.sell_price)
    if kind == "public":
        # The sum stands for the payments; how many they were is told beside it.
        payment = np.asarray(view.payments)[..., None]
        observation = observe_grid("public", view.facility_cost, payment, demand_kw, sell_price, time)
        observation[..., view.facility_cost.shape[-1] + 1] = view.homes
        return observation
    if view.payment is None:
        raise PolicyError("payment: this policy needs that of each home; join with observation paper")
    return observe_grid("paper", view.facility_cost, view.payment, demand_kw, sell_price, time)


def _check(file: PolicyFile, role: Role, facts: MarketFacts) -> None:
    """Whether a file can be used in a market, as far as that is known before its first slot."""
    if file.role != role:
        raise PolicyError(f"role = {file.role}: a {role} is wanted")
    if abs(file.dt_h - facts.dt_h) > 1e-9:
        raise PolicyError(f"dt_h = {file.dt_h:g}: the market's slots last {facts.dt_h:g} h")
    if role == "prosumer":
        return
    # How many homes there are shows in the number of features, or does not matter.
    homes = max(len(file.features) - facts.facilities - 1, 0)
    wanted = grid_features(file.observation, facts.facilities, homes)
    if file.features != wanted:
        raise PolicyError(
            f"features = {', '.join(file.features)}: a grid's {file.observation} ones with {facts.facilities} "
            f"facilities are {', '.join(wanted)}"
        )
