"""What a home knows about itself: what each of its commands would cost in a slot, and where it would lead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from zengrid.core.levels import level_commands
from zengrid.core.params import Homes
from zengrid.learn.scaling import Scaling

SOC, BUY_PRICE = 0, 3
"""Places in a prosumer's observation, of either kind; PV and consumption are between them."""


class OwnModel:
    """Battery and meter of the home behind each network, by the formulas of ``zengrid.core.home_physics``, in float32.

    Parameters
    ----------
    homes:
        One for each network.
    levels:
        Number of battery levels.
    dt_h:
        Slot length. [h]
    scaling:
        Of the observations.
    reward_scale:
        Factor on money. [1/$]
    """

    def __init__(
        self, homes: Homes, levels: int, dt_h: float, scaling: Scaling, reward_scale: float, device: torch.device
    ) -> None:
        def column(values: NDArray[np.float64]) -> Tensor:
            return torch.as_tensor(values, dtype=torch.float32, device=device)[:, None, None]

        self.commands_kw = column(level_commands(levels, homes).T)[..., 0, :]
        self.low, self.high = column(homes.soc_min), column(homes.soc_max)
        self.limit_kw = column(homes.injection_max_kw)
        self.capacity_kwh = column(homes.capacity_kwh)
        self.charged, self.drawn = column(homes.charge_efficiency) * dt_h, dt_h / column(homes.discharge_efficiency)
        self.money = reward_scale * dt_h
        self.worth = self.capacity_kwh[..., 0] * (reward_scale * float(scaling.offset[BUY_PRICE]))
        # A feature that never changes is scaled to nothing, and what it was is in its offset.
        unscale = np.where(scaling.scale > 0.0, 1.0 / np.where(scaling.scale > 0.0, scaling.scale, 1.0), 0.0)
        self.offset = torch.as_tensor(scaling.offset[: BUY_PRICE + 1], dtype=torch.float32, device=device)
        self.unscale = torch.as_tensor(unscale[: BUY_PRICE + 1], dtype=torch.float32, device=device)
        self._soc_offset, self._soc_scale = float(scaling.offset[SOC]), float(scaling.scale[SOC])

    def any_charge(self, seen: Tensor, generator: torch.Generator) -> Tensor:
        """The same observations ``(network, row, feature)`` with the battery at any permitted state of charge."""
        share = torch.rand((*seen.shape[:-1], 1), generator=generator, device=seen.device)
        soc = self.low + share * (self.high - self.low)
        return torch.cat([(soc - self._soc_offset) * self._soc_scale, seen[..., 1:]], dim=-1)

    def outcomes(self, seen: Tensor, sell_price: Tensor, seen_next: Tensor) -> tuple[Tensor, Tensor]:
        """What each command would have brought.

        Parameters
        ----------
        seen, seen_next:
            Observations of a slot and of the one after it, ``(network, row, feature)``.
        sell_price:
            Of the slot, ``(network, row)``. [$/kWh]

        Returns
        -------
        reward, seen_next:
            ``(network, row, action)`` and ``(network, row, action, feature)``.
        """
        facts = seen[..., : BUY_PRICE + 1] * self.unscale + self.offset
        soc, pv_kw, load_kw, buy_price = (facts[..., place : place + 1] for place in range(BUY_PRICE + 1))
        room_kw = (self.high - soc) * self.capacity_kwh / self.charged
        stored_kw = (soc - self.low) * self.capacity_kwh / self.drawn
        battery_kw = torch.maximum(torch.minimum(self.commands_kw, room_kw), -stored_kw)
        gained_kwh = battery_kw.clamp(min=0.0) * self.charged + battery_kw.clamp(max=0.0) * self.drawn
        soc_next = soc + gained_kwh / self.capacity_kwh.clamp(min=1e-6)
        injection_kw = torch.maximum(torch.minimum(pv_kw - load_kw - battery_kw, self.limit_kw), -self.limit_kw)
        price = torch.where(injection_kw > 0.0, buy_price, sell_price[..., None])
        after = seen_next[..., None, :].expand(*soc_next.shape, seen_next.shape[-1]).clone()
        after[..., SOC] = (soc_next - self._soc_offset) * self._soc_scale
        return injection_kw * price * self.money, after

    def stored_value(self, seen: Tensor) -> Tensor:
        """What the stored energy would earn at the middle price, ``(network, row)``.

        Networks estimate what is to be had beyond this: most of a state's value does not depend on the next command,
        and a network that must get it right first learns the difference between commands last
        (potential-based shaping: Ng, Harada, Russell, ICML 1999).
        """
        return (seen[..., SOC] / self._soc_scale + self._soc_offset) * self.worth


def repeat_homes(homes: Sequence[Homes]) -> Homes:
    """Homes of several markets, one after the other."""
    joined = homes[0]
    for more in homes[1:]:
        joined = joined.join(more)
    return joined
