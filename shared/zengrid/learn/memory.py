"""What a learner in a running market remembers: there slots may be missing between two that it saw."""

from __future__ import annotations

from typing import Self

import torch
from torch import Tensor

from zengrid.learn.replay import Replay
from zengrid.policy.tensor_file import Shape


class Memory(Replay):
    """A ring of slots with gaps: where a slot is missing, none is drawn that would take the wrong one for its next."""

    @classmethod
    def like(cls, replay: Replay) -> Self:
        """An empty one of the same shape."""
        slots, networks, days, features = replay.seen.shape
        made = cls(slots, networks, days, features, replay.n_step, replay.gamma, replay.seen.device)
        made.gap = torch.zeros(slots, dtype=torch.bool, device=replay.seen.device)
        made.gaps = 0
        return made

    gap: Tensor
    """(slot,) whether the slot before it is missing"""
    gaps: int
    """how many there are"""

    def follow(self, follows: bool) -> None:
        """Whether the slot that is added next is the one after that added last."""
        row = self.written % self.slots
        self.gaps += int(not follows) - int(self.gap[row])
        self.gap[row] = not follows

    def drawable(self) -> bool:
        """Whether there is anything to draw."""
        filled = min(self.written, self.slots)
        return filled > self.n_step and (self._without_gaps or bool(len(self._whole(filled))))

    @property
    def _without_gaps(self) -> bool:
        # The oldest slot has nothing before it, whether that is missing or forgotten.
        oldest = max(self.written - self.slots, 0) % self.slots
        return self.gaps - int(self.gap[oldest]) == 0

    def ages(self, filled: int, shape: tuple[int, int], generator: torch.Generator) -> Tensor:
        """Which slots are drawn, as places behind the oldest."""
        if self._without_gaps:
            return super().ages(filled, shape, generator)
        whole = self._whole(filled)
        return whole[torch.randint(0, len(whole), shape, generator=generator, device=whole.device)]

    def _whole(self, filled: int) -> Tensor:
        """Places behind the oldest of slots whose next ``n_step`` are all there."""
        order = (self.written - filled + torch.arange(filled, device=self.gap.device)) % self.slots
        gap = self.gap[order]
        broken = torch.zeros(filled - self.n_step, dtype=torch.bool, device=gap.device)
        for ahead in range(1, self.n_step + 1):
            broken |= gap[ahead : ahead + len(broken)]
        return torch.nonzero(~broken)[:, 0]

    def tensors(self) -> dict[str, Tensor]:
        """Everything remembered, by name."""
        return {**super().tensors(), "gap": self.gap}

    def resume(self, written: int) -> None:
        """Go on after so many slots."""
        super().resume(written)
        self.gaps = int(self.gap.sum())


def gap_shape(slots: int) -> dict[str, Shape]:
    """Type and size of what it has beside a plain one, by the name under which its learners have it."""
    return {"replay.gap": Shape("bool", (slots,))}
