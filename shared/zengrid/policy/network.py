"""Policies that were trained: a network from a policy file, evaluated with numpy."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from zengrid.core.levels import to_commands
from zengrid.core.observe import grid_features, observe_grid, observe_prosumers, time_features
from zengrid.errors import PolicyError
from zengrid.policy.facts import MarketFacts
from zengrid.policy.file import PolicyFile, Role
from zengrid.policy.prices import price_level
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
            weights = [layer.weight[rows].astype(np.float64) for layer in file.layers]
            # Each network is applied to a matrix with a row for every market side by side.
            biases = [layer.bias[rows, None].astype(np.float64) for layer in file.layers]
        else:
            weights = [layer.weight.astype(np.float64) for layer in file.layers]
            biases = [layer.bias.astype(np.float64) for layer in file.layers]
        self._own = bool(file.homes)
        # The scaling of observations becomes part of the first layer.
        weights[0] = weights[0] * file.scale
        turned = [np.ascontiguousarray(np.swapaxes(weight, -1, -2)) for weight in weights]
        biases[0] = biases[0] - (file.offset[None, :] if self._own else file.offset) @ turned[0]
        *self._hidden, self._output = zip(turned, biases, strict=True)
        self._activation = np.tanh if file.activation == "tanh" else _relu

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
        self.features = file.features
        self.levels = to_commands(file.levels[:, None], facts.homes)[:, 0] if facts.home_ids else file.levels
        """What the Q-values stand for, for the first home. [kW]"""
        self._kind = file.observation
        self._fractions = file.levels
        self._network = Network(file, facts.home_ids)
        self._first = Network(file, facts.home_ids[:1]) if file.homes else self._network

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
        observation = observe_prosumers(
            self._kind, view.soc, view.pv_kw, view.load_kw, view.buy_price, view.sell_price,
            time_features(view.slot, view.dt_h),
        )  # fmt: skip
        return to_commands(self._fractions[greedy(self._network.q_values(observation))], view.homes)

    def q_values(self, observation: Floats) -> Floats:
        """What each level is worth to the first home in so many situations, ``(row, feature)`` -> ``(row, level)``."""
        return self._first.q_values(observation[:, None, :])[:, 0]


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
        time = time_features(view.slot, view.dt_h)
        demand_kw, sell_price = np.asarray(view.demand_kw), np.asarray(view.sell_price)
        if self._kind == "public":
            # The sum stands for the payments; how many they were is told beside it.
            payment = np.asarray(view.payment_sum)[..., None]
            observation = observe_grid("public", view.facility_cost, payment, demand_kw, sell_price, time)
            observation[..., self.features.index("homes")] = view.homes
            return observation
        if view.payment is None:
            raise PolicyError("payment: this policy needs that of each home; join with observation paper")
        observation = observe_grid("paper", view.facility_cost, view.payment, demand_kw, sell_price, time)
        if observation.shape[-1] != len(self.features):
            raise PolicyError(
                f"observation has {observation.shape[-1]} numbers, with payments of {view.homes} homes: "
                f"the policy was trained on {len(self.features)} ({', '.join(self.features)})"
            )
        return observation


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
