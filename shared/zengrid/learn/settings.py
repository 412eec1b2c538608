"""What a learner is told about learning: one documented set of numbers, and presets of it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from typing import Any, ClassVar, Literal, Self

from pydantic import ConfigDict, TypeAdapter, ValidationError

from zengrid.errors import PolicyError, brief

_FROM_ONE = {"days", "memory", "steps", "pool", "batch", "n_step", "every", "updates"}
_SHARES = {"gamma", "soft_target", "epsilon_start", "epsilon_end", "epsilon_until", "average"}
_ABOVE_ZERO = {"lr", "lr_end"}
_MOST = 10**9
"""Largest number of anything."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Learning:
    """Settings of one kind of learner: the grid agent, or the prosumers."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid")

    hidden: tuple[int, ...] = (64, 64)
    """Width of each hidden layer."""
    activation: Literal["relu", "tanh"] = "relu"
    gamma: float = 0.99
    """Discount from slot to slot (paper eq. 18-19). [-]"""
    lr: float = 1e-3
    """Step size of Adam, alpha in eq. 18-19."""
    lr_end: float = 1e-4
    """Step size in the last fifth of the training."""
    batch: int = 256
    """Slots drawn from the replay memory for one update of one network."""
    double: bool = True
    """Double Q: the online network chooses the next action, the target network values it (arXiv 1509.06461)."""
    n_step: int = 1
    """Rewards summed before the estimate of the rest takes over."""
    huber: bool = True
    """Huber loss instead of the squared error."""
    soft_target: float = 0.01
    """How far the target network moves to the online network in each update."""
    epsilon_start: float = 1.0
    """Share of random actions at first."""
    epsilon_end: float = 0.02
    """Share of random actions at the end; it falls from 1, linearly."""
    epsilon_until: float = 0.6
    """Share of the training after which it has fallen. [-]"""
    every: int = 1
    """Vector steps between two rounds of updates."""
    updates: int = 1
    """Updates a round."""
    memory: int = 100_000
    """Slots each network remembers. What others did long ago is no guide to what they do now."""
    average: float = 0.998
    """What the running average of the weights, which evaluation uses, keeps in each update; 0 takes the last ones."""
    act_averaged: bool = False
    """Act by the averaged weights, too: the others then learn against a policy that changes slowly, and against the
    one that is kept."""
    own_model: bool = False
    """Prosumers only: learn from every command the home could have given, at any state of charge.

    A home knows its own battery and meter. From one slot it saw (PV, load, prices) it computes what each command would
    have cost and where it would have led, instead of waiting to have tried it.
    """

    def epsilon(self, progress: float) -> float:
        """Share of random actions, ``progress`` (0 to 1) into the training: falls linearly, then stays."""
        left = max(0.0, 1.0 - progress / self.epsilon_until) if self.epsilon_until else 0.0
        return self.epsilon_end + (self.epsilon_start - self.epsilon_end) * left


KINDS = ("grid", "prosumer")


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a whole training."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(strict=True, extra="forbid")

    grid: Learning
    prosumer: Learning
    days: int = 64
    """Days played side by side for each seed."""
    steps: int = 3_000
    """Vector steps: slots that all days take together."""
    warmup: int = 24
    """Vector steps before the first update."""
    clock: bool = True
    """Networks begin with units that look at one time of day each, where they see the time."""
    pool: int = 1_024
    """Days for training to draw from."""

    @classmethod
    def preset(cls, name: str) -> Self:
        """``fast`` and ``thorough``: ours. ``paper``: what the authors print in their later study, arXiv 2211.15858."""
        try:
            make = _PRESETS[name]
        except KeyError:
            raise PolicyError(f"preset = {name}: unknown; permitted: {', '.join(_PRESETS)}") from None
        return cls(**make)

    def with_(self, **changes: Any) -> Settings:
        """The same with some changed; ``grid_lr=1e-4`` and ``prosumer_lr=...`` reach one kind, ``lr=`` both."""
        own = {field.name for field in fields(self)} - set(KINDS)
        deep = {field.name for field in fields(Learning)}
        new = self
        for name, value in changes.items():
            kind, _, rest = name.partition("_")
            if name in own:
                new = replace(new, **{name: value})
            elif name in deep:
                new = replace(new, **{each: replace(getattr(new, each), **{name: value}) for each in KINDS})
            elif kind in KINDS and rest in deep:
                new = replace(new, **{kind: replace(getattr(new, kind), **{rest: value})})
            else:
                raise PolicyError(f"setting {name}: unknown; permitted: {', '.join(sorted(own | deep))}")
        return Settings.of(new.as_dict())

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files."""
        return asdict(self)

    @staticmethod
    def of(values: Mapping[str, Any]) -> Settings:
        """Read what ``as_dict`` wrote.

        Raises
        ------
        PolicyError
            Names the setting, the value and what is permitted.
        """
        try:
            # As JSON, where lists are tuples; everything else must be of its type.
            made = _reader().validate_json(json.dumps(values, default=str))
        except ValidationError as error:
            found = error.errors(include_url=False)[0]
            name = "_".join(map(str, found["loc"]))
            told = f"{found['msg'][0].lower()}{found['msg'][1:]}"
            raise PolicyError(f"setting {name} = {brief(found['input'])}: {told}") from None
        for name, plain, value in _values(made):
            if plain in _FROM_ONE and value < 1:
                raise PolicyError(f"setting {name} = {value}: permitted: 1 or more")
            if plain in _SHARES and not 0.0 <= value <= 1.0:
                raise PolicyError(f"setting {name} = {value}: permitted: 0 to 1")
            if plain in _ABOVE_ZERO and not 0.0 < value < math.inf:
                raise PolicyError(f"setting {name} = {value}: permitted: above 0")
            if plain == "warmup" and value < 0:
                raise PolicyError(f"setting {name} = {value}: permitted: 0 or more")
            if plain == "hidden" and not all(1 <= width <= _MOST for width in value):
                raise PolicyError(f"setting {name} = {list(value)}: permitted: widths of 1 or more")
            if type(value) is int and value > _MOST:
                raise PolicyError(f"setting {name} = {value}: permitted: {_MOST} or less")
        return made


@cache
def _reader() -> TypeAdapter[Settings]:
    return TypeAdapter(Settings)


def _values(settings: Settings) -> Iterator[tuple[str, str, Any]]:
    """Name, name without its kind, and value of every setting."""
    for field in fields(Settings):
        if field.name not in KINDS:
            yield field.name, field.name, getattr(settings, field.name)
    for kind in KINDS:
        for deep in fields(Learning):
            yield f"{kind}_{deep.name}", deep.name, getattr(getattr(settings, kind), deep.name)


_LATER_STUDY = Learning(
    activation="tanh", gamma=0.95, lr=1e-3, lr_end=1e-3, batch=64, double=False, huber=False, epsilon_end=0.01,
    epsilon_until=1.0, average=0.0,
)  # fmt: skip

# Both forget soon: the others have changed since. The leader acts by its averaged weights, so that the followers answer
# to a policy that stands still for a while.
LEADER = Learning(gamma=0.999, soft_target=0.02, n_step=2, epsilon_until=0.8, memory=30_720, act_averaged=True)
FOLLOWER = Learning(
    own_model=True, batch=32, gamma=0.999, lr=3e-3, lr_end=3e-4, soft_target=0.05, epsilon_start=0.1, memory=15_360
)

_PRESETS: dict[str, dict[str, Any]] = {
    "fast": {
        "grid": LEADER,
        "prosumer": FOLLOWER,
    },
    "thorough": {
        "grid": replace(LEADER, epsilon_until=0.6),
        # Of two equally dear hours the sooner counts more: the grid can rely on when energy comes.
        "prosumer": replace(FOLLOWER, gamma=0.99, batch=64, lr_end=5e-4, average=0.995),
        "steps": 16_000,
    },
    "paper": {
        "grid": replace(_LATER_STUDY, hidden=(1000,)),
        "prosumer": replace(_LATER_STUDY, hidden=(1000, 1000)),
        "days": 1,
        "steps": 240_000,
    },
}
