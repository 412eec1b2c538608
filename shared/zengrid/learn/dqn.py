"""Independent deep Q-learners (paper eq. 18-19): each agent has a network, a target and a memory of its own.

    Q(s, a) <- (1 - alpha) Q(s, a) + alpha (r + gamma max_a' Q(s', a'))

Nothing here knows of other agents. Learners of one shape (the grid agents of all seeds, the prosumers of all seeds) are
kept in one stack, and every line below works on all of them at once: arrays are ``(network, row, ...)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812 - its usual name
from torch import Tensor

from zengrid.learn.checkpoint import Count, State, Values, put, under, within
from zengrid.learn.networks import Weights, forward, fresh
from zengrid.learn.own_model import OwnModel
from zengrid.learn.replay import Batch, Replay
from zengrid.learn.settings import Learning
from zengrid.policy.tensor_file import Shape

WEIGHTS = ("online", "target", "averaged")
MOMENTS = ("step", "exp_avg", "exp_avg_sq")
"""What Adam remembers of each weight, by its names."""


class Counts(Values):
    """How far a stack of learners is."""

    updates: Count
    written: Count
    """slots"""


class Stack(NamedTuple):
    """The size of a stack of learners."""

    networks: int
    """How many learn, each by itself."""
    days: int
    """Days each of them lives through side by side."""
    features: int
    """Size of what they see."""
    actions: int
    """Number of what they can do."""

    def slots(self, learning: Learning) -> int:
        """How many slots they remember."""
        return max(learning.memory // self.days, learning.n_step + 2)


class DQN:
    """A stack of learners.

    Parameters
    ----------
    stack:
        Its size.
    learning:
        Settings.
    generator:
        Where all randomness comes from; its device is where everything happens.
    clock:
        Where in the observation the time of day is, see ``zengrid.learn.networks.fresh``.
    model:
        What prosumers know of their own homes; needed for ``learning.own_model``.
    """

    def __init__(
        self, stack: Stack, learning: Learning, generator: torch.Generator, clock: int | None = None,
        model: OwnModel | None = None,
    ) -> None:  # fmt: skip
        networks, days, features, actions = stack
        self.learning, self.actions = learning, actions
        self.generator, self.model = generator, model if learning.own_model else None
        weights = fresh(networks, (features, *learning.hidden, actions), generator, clock)
        self.online: Weights = [weight.clone().requires_grad_() for weight in weights]
        self.target: Weights = [weight.clone() for weight in weights]
        self.averaged: Weights = [weight.clone() for weight in weights]
        self.optimiser = torch.optim.Adam(self.online, lr=learning.lr, fused=True)
        for weight in self.online:
            # As Adam begins by itself, but from the start: what there is to save does not depend on when.
            zero = torch.zeros_like(weight)
            moments = (torch.zeros((), device=weight.device), zero, zero.clone())
            self.optimiser.state[weight] = dict(zip(MOMENTS, moments, strict=True))
        self.replay = Replay(
            stack.slots(learning), networks, days, features, learning.n_step, learning.gamma, generator.device
        )
        self.updates = 0

    def q(self, weights: Weights, seen: Tensor) -> Tensor:
        """Estimated value of each action, ``(network, row, action)``."""
        return forward(weights, seen, self.learning.activation)

    @torch.no_grad()
    def act(self, seen: Tensor, epsilon: float) -> Tensor:
        """The best action by the network's own estimate; with probability epsilon, any. ``(network, row)``."""
        weights = self.averaged if self.learning.act_averaged else self.online
        greedy = self.q(weights, seen).argmax(-1)
        shape, generator, device = greedy.shape, self.generator, self.generator.device
        explores = torch.rand(shape, generator=generator, device=device) < epsilon
        anything = torch.randint(self.actions, shape, generator=generator, device=device)
        return torch.where(explores, anything, greedy)

    def learn(self, progress: float) -> Tensor:
        """One update of every network; returns their losses, ``(network,)``.

        Parameters
        ----------
        progress:
            How far the training is, 0 to 1: the step size falls in the last fifth.
        """
        learning = self.learning
        batch = self.replay.draw(learning.batch, self.generator)
        if self.model is None:
            wanted = batch.reward + batch.rest * self.value(batch.seen_next)
            estimate = self.q(self.online, batch.seen).gather(-1, batch.action[..., None])[..., 0]
        else:
            seen, wanted = self.imagine(batch, self.model)
            estimate = self.q(self.online, seen)
        error = F.huber_loss if learning.huber else F.mse_loss
        loss = error(estimate, wanted, reduction="none").flatten(1).mean(-1)
        for weight, gradient in zip(self.online, torch.autograd.grad(loss.sum(), self.online), strict=True):
            weight.grad = gradient
        for group in self.optimiser.param_groups:
            group["lr"] = learning.lr if progress < 0.8 else learning.lr_end
        self.optimiser.step()
        self.updates += 1
        with torch.no_grad():
            torch._foreach_lerp_(self.target, self.online, learning.soft_target)
            # The average forgets where it began: at first it spans a tenth of the updates so far.
            keep = min(learning.average, self.updates / (self.updates + 10.0))
            torch._foreach_lerp_(self.averaged, self.online, 1.0 - keep)
        return loss.detach()

    @torch.no_grad()
    def value(self, seen: Tensor) -> Tensor:
        """What is still to come, by the target network: ``max_a' Q(s', a')``, ``(network, row)``."""
        values = self.q(self.target, seen)
        if not self.learning.double:
            return values.max(-1).values
        best = self.q(self.online, seen).argmax(-1, keepdim=True)
        return values.gather(-1, best)[..., 0]

    @torch.no_grad()
    def imagine(self, batch: Batch, model: OwnModel) -> tuple[Tensor, Tensor]:
        """Slots as seen with the battery at any state of charge, and the value of every command in them."""
        seen = model.any_charge(batch.seen, self.generator)
        reward, after = model.outcomes(seen, batch.sell_price, batch.seen_next)
        after = after.flatten(1, 2)
        to_come = (self.value(after) + model.stored_value(after)).view(reward.shape)
        return seen, reward + batch.rest[..., None] * to_come - model.stored_value(seen)[..., None]

    def state(self) -> State[Counts]:
        """Everything that a later ``restore`` needs to go on exactly."""
        return State(Counts(updates=self.updates, written=self.replay.written), self._tensors())

    def restore(self, state: State[Counts]) -> None:
        """Go back to a state that was checked (``check_learners``)."""
        put(state.tensors, self._tensors())
        self.updates = state.values.updates
        self.replay.resume(state.values.written)

    def _tensors(self) -> dict[str, Tensor]:
        """All arrays in use, by the names that ``learner_shapes`` gives them."""
        named = {f"{name}.{place}": it for name in WEIGHTS for place, it in enumerate(getattr(self, name))}
        moments = {
            f"{name}.{place}": self.optimiser.state[it][name]
            for name in MOMENTS
            for place, it in enumerate(self.online)
        }
        return {**named, **moments, **under("replay", self.replay.tensors())}


def learner_shapes(stack: Stack, learning: Learning) -> dict[str, Shape]:
    """Type and size of every array of a stack of learners."""
    sizes = (stack.features, *learning.hidden, stack.actions)
    slots = stack.slots(learning)
    memory = (slots, stack.networks, stack.days)
    found: dict[str, tuple[int, ...]] = {
        "replay.seen": (*memory, stack.features), "replay.action": memory, "replay.reward": memory,
        "replay.sell_price": (slots,), "replay.goes_on": (slots,),
    }  # fmt: skip
    # Weight and bias of one layer after the other.
    layers = [(stack.networks, rows, outputs) for inputs, outputs in pairwise(sizes) for rows in (inputs, 1)]
    for name in (*WEIGHTS, *MOMENTS):
        found |= {f"{name}.{place}": () if name == "step" else size for place, size in enumerate(layers)}
    return {name: Shape("int64" if name == "replay.action" else "float32", size) for name, size in found.items()}


def check_learners(name: str, tensors: Mapping[str, Tensor], actions: int) -> None:
    """Refuse arrays of the right sizes (``learner_shapes``, under this name) that no stack can have left behind."""
    within(f"{name}.replay.action", tensors, 0, actions - 1)
    within(f"{name}.replay.goes_on", tensors, 0, 1)
    for each in tensors:
        if each.startswith((f"{name}.step.", f"{name}.exp_avg_sq.")):
            within(each, tensors, 0.0, math.inf)
