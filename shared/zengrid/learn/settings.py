"""What a learner is told about learning: one documented set of numbers, and presets of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, Self

from zengrid.errors import PolicyError


@dataclass(frozen=True, slots=True, kw_only=True)
class Learning:
    """Settings of one kind of learner: the grid agent, or the prosumers."""

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

    def with_(self, **changes: Any) -> Self:
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
        return new

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files."""
        return asdict(self)

    @classmethod
    def of(cls, values: dict[str, Any]) -> Self:
        """Read what ``as_dict`` wrote."""
        kinds = {kind: Learning(**{**values[kind], "hidden": tuple(values[kind]["hidden"])}) for kind in KINDS}
        return cls(**{**values, **kinds})


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
