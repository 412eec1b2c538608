"""Many small networks of one shape as one: every layer of all of them is a single batched product."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor

Activation = Literal["relu", "tanh"]
Weights = list[Tensor]
"""Weight ``(network, in, out)`` and bias ``(network, 1, out)`` of one layer after the other."""

HOURS = 24
WIDTH = 1.5 * 2.0 * math.pi / HOURS
"""Half the time of day that one unit of the clock looks at. [rad]"""


def fresh(networks: int, sizes: Sequence[int], generator: torch.Generator, clock: int | None = None) -> Weights:
    """Untrained weights, uniform within +-1/sqrt(inputs) as usual for such layers.

    Parameters
    ----------
    networks:
        How many.
    sizes:
        Inputs, hidden layers, outputs.
    generator:
        Where randomness comes from.
    clock:
        Position of the sine of the time of day among the inputs (the cosine follows); None where they see no time.
        Then up to 24 units of the first layer begin as hours of a clock: ``relu(cos(t - t_k) - cos(WIDTH))`` is
        zero but around ``t_k``. From sine and cosine alone, telling one hour from the next takes thousands of
        updates.
    """
    weights = []
    for inputs, outputs in pairwise(sizes):
        bound = inputs**-0.5
        for shape in ((networks, inputs, outputs), (networks, 1, outputs)):
            drawn = torch.rand(shape, generator=generator, device=generator.device)
            weights.append((drawn * 2.0 - 1.0) * bound)
    if clock is not None and len(sizes) > 2:
        units = min(HOURS, sizes[1])
        angle = torch.arange(units, device=generator.device) * (2.0 * math.pi / units)
        steep = 1.0 / (1.0 - math.cos(WIDTH))
        weights[0][:, :, :units] *= 0.3  # the other inputs bend an hour, and do not drown it
        weights[0][:, clock, :units] = torch.sin(angle) * steep
        weights[0][:, clock + 1, :units] = torch.cos(angle) * steep
        weights[1][:, :, :units] = -math.cos(WIDTH) * steep
    return weights


def forward(weights: Weights, inputs: Tensor, activation: Activation) -> Tensor:
    """Outputs ``(network, row, out)`` for inputs ``(network, row, in)``."""
    # In place: another array of a megabyte for each layer costs as much as the products, in page faults.
    bend = torch.relu_ if activation == "relu" else torch.tanh_
    values = inputs
    for layer in range(0, len(weights) - 2, 2):
        values = bend(torch.baddbmm(weights[layer + 1], values, weights[layer]))
    return torch.baddbmm(weights[-1], values, weights[-2])
