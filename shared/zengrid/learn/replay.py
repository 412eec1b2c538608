"""What the learners remember: the last slots of all their days, in order: after a slot comes its successor."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class Batch(NamedTuple):
    """Slots drawn from the memory, each array ``(network, row, ...)``."""

    seen: Tensor
    """(network, row, feature) observation"""
    action: Tensor
    """(network, row) position of the action"""
    reward: Tensor
    """(network, row) discounted sum over ``n_step`` slots"""
    seen_next: Tensor
    """(network, row, feature) observation ``n_step`` slots later"""
    rest: Tensor
    """(network, row) what the value of that counts: gamma ** n_step, or 0 where the day ended in between"""
    sell_price: Tensor
    """(network, row) posted price of the slot [$/kWh]"""


class Replay:
    """A ring of slots; each slot holds all networks and days.

    Parameters
    ----------
    slots:
        How many are kept.
    networks, days, features:
        Shape of what is seen in a slot.
    n_step, gamma:
        Of the returns drawn.
    """

    def __init__(
        self, slots: int, networks: int, days: int, features: int, n_step: int, gamma: float, device: torch.device
    ) -> None:
        self.slots, self.networks, self.days, self.n_step, self.gamma = slots, networks, days, n_step, gamma
        shape = (slots, networks, days)
        self.seen = torch.zeros((*shape, features), device=device)
        self.action = torch.zeros(shape, dtype=torch.int64, device=device)
        self.reward = torch.zeros(shape, device=device)
        # The same for all networks and days.
        self.sell_price = torch.zeros(slots, device=device)
        self.goes_on = torch.zeros(slots, device=device)
        self.written = 0
        self._network = (torch.arange(networks, device=device) * days)[:, None]

    def add(self, seen: Tensor, action: Tensor, reward: Tensor, sell_price: float, goes_on: bool) -> None:
        """Remember one slot, ``(network, day, ...)``; ``goes_on``: whether the next slot belongs to the same story."""
        row = self.written % self.slots
        self.seen[row], self.action[row], self.reward[row] = seen, action, reward
        self.sell_price[row], self.goes_on[row] = sell_price, float(goes_on)
        self.written += 1

    def draw(self, rows: int, generator: torch.Generator) -> Batch:
        """Slots at random, other ones for each network."""
        filled = min(self.written, self.slots)
        if filled <= self.n_step:
            raise ValueError(f"{filled} slots remembered: more than n_step = {self.n_step} are needed to draw from")
        shape, device = (self.networks, rows), self.seen.device
        age = self.ages(filled, shape, generator)
        column = self._network + torch.randint(0, self.days, shape, generator=generator, device=device)
        row = (self.written - filled + age) % self.slots

        def at(ring: Tensor, row: Tensor) -> Tensor:
            place = row * (self.networks * self.days) + column
            return ring.flatten(0, 2).index_select(0, place.flatten()).view(*shape, *ring.shape[3:])

        reward, rest = at(self.reward, row), self.goes_on[row] * self.gamma
        for ahead in range(1, self.n_step):
            later = (row + ahead) % self.slots
            reward = reward + rest * at(self.reward, later)
            rest = rest * (self.goes_on[later] * self.gamma)
        seen_next = at(self.seen, (row + self.n_step) % self.slots)
        return Batch(at(self.seen, row), at(self.action, row), reward, seen_next, rest, self.sell_price[row])

    def ages(self, filled: int, shape: tuple[int, int], generator: torch.Generator) -> Tensor:
        """Which of the slots are drawn, as places behind the oldest, ``(network, row)``."""
        return torch.randint(0, filled - self.n_step, shape, generator=generator, device=self.seen.device)

    def tensors(self) -> dict[str, Tensor]:
        """Everything remembered, by name; ``written`` says where in it the newest is."""
        names = ("seen", "action", "reward", "sell_price", "goes_on")
        return {name: getattr(self, name) for name in names}

    def resume(self, written: int) -> None:
        """Go on after so many slots, once ``tensors`` hold what was remembered then."""
        self.written = written
