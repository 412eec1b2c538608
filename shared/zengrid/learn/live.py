"""Learning in a running market: one agent's learner, told slot by slot what it saw and what came of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from reprlib import repr as shown
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field

from zengrid import __version__
from zengrid.core.levels import level_fractions
from zengrid.core.observe import ObservationKind, grid_features, prosumer_features
from zengrid.errors import PolicyError, brief
from zengrid.learn.checkpoint import (
    Count,
    Finite,
    NumpyGenerator,
    State,
    Values,
    check,
    check_generator,
    part,
    read_tensors,
    read_values,
    save,
    shapes,
    under,
)
from zengrid.learn.dqn import DQN, Counts, Stack, check_learners, learner_shapes
from zengrid.learn.live_scales import first_day_scaling, power_kw, reward_scale
from zengrid.learn.live_settings import Live
from zengrid.learn.memory import Memory, gap_shape
from zengrid.learn.own_model import OwnModel
from zengrid.learn.scaling import Scaling
from zengrid.learn.settings import Learning
from zengrid.policy.facts import MarketFacts
from zengrid.policy.file import Activation, Layer, PolicyFile, Role
from zengrid.policy.network import Network, greedy
from zengrid.policy.tensor_file import TensorFile, naming

Floats = NDArray[np.float64]

FORMAT = "zengrid.learner/1"
"""Kind and version of what a learner goes on from."""
ANEW = "give another folder to start anew"
STARTED_UPDATES = 10_000
"""After so many updates a policy counts as made that is gone on from; the running average forgets it as slowly."""


class Moment(NamedTuple):
    """A slot of the market."""

    day: int
    slot: int


class Begun(Values):
    """What a learner is that no longer only watches."""

    features: tuple[str, ...]
    offset: tuple[Finite, ...]
    scale: tuple[Annotated[Finite, Field(ge=0.0)], ...]
    reward_scale: Annotated[Finite, Field(gt=0.0)]
    hidden: tuple[Annotated[int, Field(ge=1)], ...]
    activation: Activation
    epsilon_start: Annotated[float, Field(ge=0.0, le=1.0)]
    lr: Annotated[Finite, Field(gt=0.0)]
    dqn: Counts


class Written(Values):
    """What the file of a learner holds beside its arrays."""

    role: Role
    agent: str
    observation: ObservationKind
    dt_h: float
    levels: tuple[float, ...]
    homes: tuple[str, ...]
    capacity_kwh: tuple[float, ...]
    slots: Count
    last: tuple[Count, Count] | None
    rng: NumpyGenerator
    begun: Begun | None


class _Seen(NamedTuple):
    """What was seen in a slot whose outcome is still to come."""

    moment: Moment
    observation: Floats
    """(home, feature)"""
    level: NDArray[np.intp] | None
    """(home,) what it chose; None where a rule decided"""
    sell_price: float


class _Row(NamedTuple):
    """A slot to remember, from before the learner knew its scales."""

    observation: Floats
    level: NDArray[np.intp] | None
    reward: Floats
    sell_price: float
    goes_on: bool
    follows: bool


class Learner:
    """What learners of both roles share. On its first day it watches; its owner decides by a rule.

    Parameters
    ----------
    role, agent:
        Who learns.
    facts:
        What the agent was told of the market.
    live:
        How to learn.
    kind:
        What it sees.
    start:
        A policy to go on from; otherwise it starts from nothing.
    """

    def __init__(
        self, role: Role, agent: str, facts: MarketFacts, live: Live, kind: ObservationKind, start: PolicyFile | None
    ) -> None:
        self.role, self.agent, self.facts, self.live, self.kind = role, agent, facts, live, kind
        self.networks = max(len(facts.home_ids), 1)
        if role == "grid":
            self.levels = np.array(facts.buy_prices)
        else:
            self.levels = level_fractions(facts.battery_levels)
        draw = np.random.SeedSequence([live.seed, *agent.encode()])
        self._rng = np.random.default_rng(draw)
        self._generator = torch.Generator().manual_seed(int(draw.generate_state(1)[0]))
        self.slots = 0
        """in which it was told what it did"""
        self._seen: _Seen | None = None
        self._last: Moment | None = None
        self._watched: list[_Row] = []
        self.dqn: DQN | None = None
        self.features: tuple[str, ...] = prosumer_features(kind) if role == "prosumer" else ()
        if start is not None:
            self._start_from(start)

    # ---------------------------------------------------------------- slot by slot

    @property
    def watches(self) -> bool:
        """Whether it has not begun to act: on its first day."""
        return self.dqn is None

    @property
    def progress(self) -> float:
        """How far exploration has fallen, 0 to 1."""
        return min(self.slots / self.live.slots, 1.0)

    def choose(self, moment: Moment, observation: Floats, sell_price: float) -> NDArray[np.intp] | None:
        """The position of a level for each home ``(home,)``; None where it still watches.

        Parameters
        ----------
        moment:
            The slot.
        observation:
            ``(home, feature)``
        sell_price:
            Posted price of the slot. [$/kWh]
        """
        level = None
        if self.dqn is not None:
            if observation.shape[-1] != len(self.features):
                raise PolicyError(
                    f"observation has {observation.shape[-1]} numbers: {self.agent} has learned from "
                    f"{len(self.features)} ({', '.join(self.features)})"
                )
            best = greedy(self._network.q_values(observation))
            anything = self._rng.integers(self.levels.size, size=best.shape)
            explores = self._rng.random(best.shape) < self.dqn.learning.epsilon(self.progress)
            level = np.where(explores, anything, best)
        self._seen = _Seen(moment, observation, level, sell_price)
        return level

    def _settled(self, moment: Moment, level: NDArray[np.intp] | None, reward: Floats) -> None:
        """Remember the slot that was seen last, if this is what came of it; all others are dropped.

        Parameters
        ----------
        moment:
            The slot that was settled.
        level:
            What was really done, ``(home,)``; None where that is no level.
        reward:
            ``(home,)`` [$]
        """
        seen, self._seen = self._seen, None
        if seen is None or seen.moment != moment:
            return
        if level is None and self._knows_all_commands:
            level = np.zeros(self.networks, dtype=np.intp)  # what was done does not matter where all is imagined
        if level is None and not self.watches:
            return
        ends = moment.slot + 1 == self.facts.slots_per_day
        row = _Row(
            seen.observation, level, reward, seen.sell_price, not (ends and self.facts.soc_reset == "daily"),
            follows=self._last is not None and moment == self._after(self._last),
        )  # fmt: skip
        self._last = moment
        self.slots += 1
        if self.dqn is None:
            self._watched.append(row)
        else:
            self._remember(row)

    def _after(self, moment: Moment) -> Moment:
        day, slot = moment
        return Moment(day, slot + 1) if slot + 1 < self.facts.slots_per_day else Moment(day + 1, 0)

    @property
    def _knows_all_commands(self) -> bool:
        return self.live.learning.own_model and self.role == "prosumer"

    def _remember(self, row: _Row) -> None:
        assert self.dqn is not None
        assert row.level is not None
        seen = torch.from_numpy(self._scaling(row.observation))[:, None]
        reward = torch.from_numpy((row.reward * self._reward_scale).astype(np.float32))[:, None]
        level = torch.from_numpy(row.level.astype(np.int64))[:, None]
        self._memory.follow(row.follows)
        self._memory.add(seen, level, reward, row.sell_price, row.goes_on)

    def learn(self) -> bool:
        """One update, where enough is remembered; call it once the action has left."""
        if self.dqn is None and len(self._watched) > self.facts.slots_per_day:
            self._begin(*self._first_day())
        if self.dqn is None or self.slots % self.live.learning.every or not self._memory.drawable():
            return False
        for _ in range(self.live.learning.updates):
            self.dqn.learn(self.progress)
        self._network.renew(self._layers())
        return True

    # ---------------------------------------------------------------- beginnings

    def _first_day(self) -> tuple[Scaling, float]:
        """Scales of observations and rewards, from what the first day brought."""
        rows = np.concatenate([row.observation for row in self._watched])
        if self.role == "grid":
            homes = rows.shape[-1] - self.facts.facilities - 1
            self.features = grid_features(self.kind, self.facts.facilities, homes)
            usual_kw = float(rows[:, self.features.index("demand_kw")].mean())
        else:
            usual_kw = power_kw(self.facts)
        return first_day_scaling(self.features, rows, self.facts), reward_scale(self.facts, usual_kw)

    def _begin(self, scaling: Scaling, scale: float, learning: Learning | None = None) -> None:
        """Get ready to learn, from nothing."""
        facts, live = self.facts, self.live
        learning = learning or live.learning
        self._scaling, self._reward_scale = scaling, scale
        model = None
        if self.role == "prosumer":
            model = OwnModel(facts.homes, facts.battery_levels, facts.dt_h, scaling, scale, self._generator.device)
        clock = self.features.index("time_sin") if "time_sin" in self.features else None
        self.dqn = DQN(self._stack(self.features), learning, self._generator, clock, model)
        self.dqn.replay = self._memory = Memory.like(self.dqn.replay)
        self._network = Network(self.file(), facts.home_ids)
        for row in self._watched:
            if row.level is None:
                self._last = None  # a rule's command is no level: nothing to remember but the scales
            else:
                self._remember(row)
        self._watched = []

    def _start_from(self, file: PolicyFile) -> None:
        """Get ready to learn, from a policy."""
        if self.role == "prosumer":
            file = file.for_homes(self.facts.home_ids, self.facts.homes, np.array(self.facts.pv_kw))
        if file.observation != self.kind:
            raise PolicyError(f"observation = {self.kind}: the policy to go on from sees {file.observation}")
        if file.levels.shape != self.levels.shape or np.abs(file.levels - self.levels).max() > 1e-9:
            raise PolicyError(f"levels = {file.levels.tolist()}: the market's are {self.levels.tolist()}")
        self.features = file.features
        if self.role == "prosumer":
            usual_kw = power_kw(self.facts)
        else:
            usual_kw = float(file.offset[file.features.index("demand_kw")])
        scale = file.training.get("reward_scale", reward_scale(self.facts, usual_kw))
        if not (isinstance(scale, int | float) and 0.0 < scale < math.inf):
            raise PolicyError(f"reward_scale = {shown(scale)}: the policy to go on from must have a number above 0")
        learning = replace(self.live.learning, hidden=file.hidden, activation=file.activation)
        # It need not find out from nothing what it knows already.
        learning = replace(learning, epsilon_start=learning.epsilon_end, lr=learning.lr_end)
        self._begin(Scaling(file.offset, file.scale), scale, learning)
        assert self.dqn is not None
        with torch.no_grad():
            for place, layer in enumerate(file.layers):
                for part, values in enumerate((np.swapaxes(layer.weight, -1, -2), layer.bias[..., None, :])):
                    given = torch.from_numpy(np.ascontiguousarray(values))
                    for weights in (self.dqn.online, self.dqn.target, self.dqn.averaged):
                        weights[2 * place + part].copy_(given)
        self.dqn.updates = STARTED_UPDATES
        self._network.renew(self._layers())

    # ---------------------------------------------------------------- what it has learned

    def _layers(self) -> list[Layer]:
        assert self.dqn is not None
        weights = [weight.numpy() for weight in self.dqn.averaged]
        pairs = zip(weights[::2], weights[1::2], strict=True)
        if self.facts.home_ids:
            return [Layer(np.swapaxes(weight, -1, -2), bias[:, 0]) for weight, bias in pairs]
        return [Layer(weight[0].T, bias[0, 0]) for weight, bias in pairs]

    def file(self) -> PolicyFile:
        """The policy by which it acts, exploration left out; raises PolicyError where it still watches."""
        if self.dqn is None:
            raise PolicyError(f"{self.agent}: still watches its first day and has learned nothing")
        layers = [Layer(np.array(weight), np.array(bias)) for weight, bias in self._layers()]
        notes = {
            "scenario": self.facts.scenario, "agent": self.agent, "slots": self.slots, "updates": self.dqn.updates,
            "seed": self.live.seed, "version": __version__, "reward_scale": self._reward_scale,
        }  # fmt: skip
        return PolicyFile(
            role=self.role, observation=self.kind, features=self.features, offset=self._scaling.offset,
            scale=self._scaling.scale, levels=self.levels, activation=self.dqn.learning.activation,
            layers=tuple(layers), dt_h=self.facts.dt_h, name=f"{self.agent}-learning", homes=self.facts.home_ids,
            training=notes,
        )  # fmt: skip

    def save(self, path: Path) -> None:
        """Write all it needs to go on, and beside it the policy as a file; an interruption leaves those before."""
        save(path, FORMAT, self.state())
        if self.dqn is not None:
            self.file().save(path.with_suffix(".safetensors"))

    def state(self) -> State[Written]:
        """Everything that ``restore`` needs."""
        tensors = {"generator": self._generator.get_state()}
        begun = None
        if self.dqn is not None:
            counts, own = self.dqn.state()
            tensors |= under("dqn", own)
            learning = self.dqn.learning
            begun = Begun(
                features=self.features, offset=tuple(self._scaling.offset.tolist()),
                scale=tuple(self._scaling.scale.tolist()), reward_scale=self._reward_scale, hidden=learning.hidden,
                activation=learning.activation, epsilon_start=learning.epsilon_start, lr=learning.lr, dqn=counts,
            )  # fmt: skip
        return State(
            Written(
                **self._identity(), slots=self.slots, last=self._last, rng=NumpyGenerator.of(self._rng), begun=begun
            ),
            tensors,
        )

    def _identity(self) -> dict[str, Any]:
        """What must be the same in the market where it goes on."""
        facts = self.facts
        return {
            "role": self.role, "agent": self.agent, "observation": self.kind, "dt_h": facts.dt_h,
            "levels": tuple(self.levels.tolist()), "homes": facts.home_ids,
            "capacity_kwh": tuple(facts.homes.capacity_kwh.tolist()),
        }  # fmt: skip

    def restore(self, path: Path) -> None:
        """Go on where the learner that wrote this file was.

        Raises
        ------
        PolicyError
            Where it cannot be read, belongs to another agent or market, or is nothing that a learner can have left.
            Nothing in it is ever run, and the learner stays as it is.
        """
        with naming("learner", path), TensorFile(path) as file:
            values = read_values(file, FORMAT, Written)
            for name, mine in self._identity().items():
                theirs = getattr(values, name)
                if theirs != mine:
                    raise PolicyError(f"{name} = {brief(theirs)}, here it is {brief(mine)}; {ANEW}")
            begun, wanted = values.begun, {"generator": shapes({"": self._generator.get_state()})[""]}
            if begun is not None:
                learning = self._learning_of(begun)
                stack = self._stack(begun.features)
                wanted |= under("dqn", {**learner_shapes(stack, learning), **gap_shape(stack.slots(learning))})
            tensors = read_tensors(file, wanted)
            check(tensors, wanted)
            check_generator(tensors["generator"], self._generator)
            if begun is not None:
                check_learners("dqn", tensors, self.levels.size)
        if begun is not None:
            self.features = begun.features
            self._begin(Scaling(np.array(begun.offset), np.array(begun.scale)), begun.reward_scale, learning)
            assert self.dqn is not None
            self.dqn.restore(State(begun.dqn, part("dqn", tensors)))
            self._network.renew(self._layers())
        self.slots = values.slots
        self._last = None if values.last is None else Moment(*values.last)
        self._rng = values.rng.made()
        self._generator.set_state(tensors["generator"])

    def _stack(self, features: tuple[str, ...]) -> Stack:
        return Stack(self.networks, 1, len(features), self.levels.size)

    def _learning_of(self, begun: Begun) -> Learning:
        """How a learner learned that was begun elsewhere; raises PolicyError where it does not fit this market."""
        names = begun.features
        if self.role == "prosumer":
            known = prosumer_features(self.kind)
        else:
            known = grid_features(self.kind, self.facts.facilities, max(len(names) - self.facts.facilities - 1, 0))
        if names != known:
            raise PolicyError(f"features = {', '.join(names)}: here they are {', '.join(known)}; {ANEW}")
        for name in ("offset", "scale"):
            if len(getattr(begun, name)) != len(names):
                raise PolicyError(f"{name} has {len(getattr(begun, name))} numbers: there are {len(names)} features")
        return replace(
            self.live.learning, hidden=begun.hidden, activation=begun.activation, epsilon_start=begun.epsilon_start,
            lr=begun.lr,
        )  # fmt: skip
