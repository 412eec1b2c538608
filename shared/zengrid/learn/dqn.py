"""Independent deep Q-learners (paper eq. 18-19): each agent has a network, a target and a memory of its own.

    Q(s, a) <- (1 - alpha) Q(s, a) + alpha (r + gamma max_a' Q(s', a'))

Nothing here knows of other agents. Learners of one shape (the grid agents of all seeds, the prosumers of all seeds) are
kept in one stack, and every line below works on all of them at once: arrays are ``(network, row, ...)``.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.nn.functional as F  # noqa: N812 - its usual name
from torch import Tensor

from zengrid.learn.networks import Weights, forward, fresh
from zengrid.learn.own_model import OwnModel
from zengrid.learn.replay import Batch, Replay
from zengrid.learn.settings import Learning


class DQN:
    """A stack of learners.

    Parameters
    ----------
    networks:
        How many learn, each by itself.
    days:
        Days each of them lives through side by side.
    features, actions:
        Size of what they see, and number of what they can do.
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
        self, networks: int, days: int, features: int, actions: int, learning: Learning, generator: torch.Generator,
        clock: int | None = None, model: OwnModel | None = None,
    ) -> None:  # fmt: skip
        self.learning, self.actions = learning, actions
        self.generator, self.model = generator, model if learning.own_model else None
        weights = fresh(networks, (features, *learning.hidden, actions), generator, clock)
        self.online: Weights = [weight.clone().requires_grad_() for weight in weights]
        self.target: Weights = [weight.clone() for weight in weights]
        self.averaged: Weights = [weight.clone() for weight in weights]
        self.optimiser = torch.optim.Adam(self.online, lr=learning.lr, fused=True)
        self.replay = Replay(
            max(learning.memory // days, learning.n_step + 2), networks, days, features, learning.n_step,
            learning.gamma, generator.device,
        )  # fmt: skip
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

    def state(self) -> dict[str, Any]:
        """Everything that a later ``restore`` needs to go on exactly."""
        return {
            "online": [weight.detach() for weight in self.online],
            "target": self.target,
            "averaged": self.averaged,
            "optimiser": self.optimiser.state_dict(),
            "replay": self.replay.state(),
            "updates": self.updates,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        with torch.no_grad():
            for name in ("online", "target", "averaged"):
                for weight, saved in zip(getattr(self, name), state[name], strict=True):
                    weight.copy_(saved)
        self.optimiser.load_state_dict(state["optimiser"])
        self.replay.restore(state["replay"])
        self.updates = state["updates"]
