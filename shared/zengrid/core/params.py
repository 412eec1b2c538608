"""Constant parameters of a market: the homes' batteries and meters, the generation facilities, the slot length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Homes:
    """Batteries and grid connections of the prosumers; every array is shaped ``(home,)``.

    Parameters
    ----------
    capacity_kwh:
        Battery capacity (the paper's eta, eq. 13; its Table I prints kW and means kWh). 0 means no battery. [kWh]
    charge_max_kw, discharge_max_kw:
        Largest charging and discharging power, both given as positive numbers. [kW]
    soc_min, soc_max:
        Permitted state of charge, as a fraction of the capacity. [-]
    charge_efficiency, discharge_efficiency:
        Stored energy per energy taken in, delivered energy per stored energy taken out. [-]
    injection_max_kw:
        Limit of the grid connection in both directions (paper eq. 6). [kW]
    soc_initial:
        State of charge at the start of a run, and of each day where it is reset daily. [-]
    """

    capacity_kwh: Floats
    charge_max_kw: Floats
    discharge_max_kw: Floats
    soc_min: Floats
    soc_max: Floats
    charge_efficiency: Floats
    discharge_efficiency: Floats
    injection_max_kw: Floats
    soc_initial: Floats

    @classmethod
    def of(
        cls,
        capacity_kwh: ArrayLike,
        charge_max_kw: ArrayLike = 2.0,
        discharge_max_kw: ArrayLike = 2.0,
        soc_min: ArrayLike = 0.1,
        soc_max: ArrayLike = 0.9,
        charge_efficiency: ArrayLike = 1.0,
        discharge_efficiency: ArrayLike = 1.0,
        injection_max_kw: ArrayLike = 10.0,
        soc_initial: ArrayLike = 0.5,
    ) -> Self:
        """Build from scalars or sequences, broadcast to one value a home."""
        return cls.from_columns({
            "capacity_kwh": capacity_kwh, "charge_max_kw": charge_max_kw, "discharge_max_kw": discharge_max_kw,
            "soc_min": soc_min, "soc_max": soc_max, "charge_efficiency": charge_efficiency,
            "discharge_efficiency": discharge_efficiency, "injection_max_kw": injection_max_kw,
            "soc_initial": soc_initial,
        })  # fmt: skip

    @classmethod
    def from_columns(cls, columns: Mapping[str, ArrayLike]) -> Self:
        """Build from a scalar or sequence for each field by its name, broadcast to one value a home."""
        given = (np.asarray(columns[name], dtype=np.float64) for name in HOME_FIELDS)
        arrays = np.broadcast_arrays(*given)
        return cls(**{
            name: np.atleast_1d(array).copy() for name, array in zip(HOME_FIELDS, arrays, strict=True)
        })  # fmt: skip

    @classmethod
    def from_rows(cls, rows: Iterable[object]) -> Self:
        """Build from one object a home, which has an attribute for each field."""
        homes = list(rows)
        return cls.from_columns({name: [getattr(home, name) for home in homes] for name in HOME_FIELDS})

    @property
    def count(self) -> int:
        """Number of homes."""
        return int(self.capacity_kwh.shape[-1])

    def take(self, index: ArrayLike) -> Self:
        """The homes at the given positions, in that order (numpy indexing rules)."""
        return type(self)(**{name: getattr(self, name)[np.asarray(index)] for name in HOME_FIELDS})

    def join(self, others: Self) -> Self:
        """These homes, followed by the others."""
        return type(self)(**{
            name: np.concatenate([getattr(self, name), getattr(others, name)]) for name in HOME_FIELDS
        })  # fmt: skip


HOME_FIELDS = tuple(field.name for field in fields(Homes))
"""Names of what the market must know of a home, in the order of ``Homes``; messages and scenarios use them too."""


@dataclass(frozen=True, slots=True, eq=False)
class Facilities:
    """Generation facilities in the order they are dispatched; every array is shaped ``(facility,)``.

    Running facility ``i`` at ``P`` kW costs ``a P^2 + b P + c`` dollars an hour. Only the first facility has a minimum
    output; surplus below it is curtailed.
    """

    p_min_kw: Floats
    p_max_kw: Floats
    cost_a: Floats
    cost_b: Floats
    cost_c: Floats

    @classmethod
    def of(
        cls,
        p_max_kw: ArrayLike,
        cost_b: ArrayLike,
        cost_a: ArrayLike = 0.0,
        cost_c: ArrayLike = 0.0,
        p_min_kw: ArrayLike = 0.0,
    ) -> Self:
        """Build from scalars or sequences, broadcast to one value a facility."""
        given = (p_min_kw, p_max_kw, cost_a, cost_b, cost_c)
        arrays = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in given))
        return cls(*(np.atleast_1d(array).copy() for array in arrays))

    @property
    def count(self) -> int:
        """Number of facilities."""
        return int(self.p_max_kw.shape[0])


class MarketParams:
    """Everything that ``settle`` needs besides state, action and profiles, with values that are computed once.

    Parameters
    ----------
    homes, facilities:
        The prosumers and the generation facilities.
    dt_h:
        Length of one slot. [h]
    value_of_lost_load:
        Price that the grid is charged for demand that its facilities cannot meet. [$/kWh]
    """

    __slots__ = (
        "battery_min_kw", "dt_h", "facilities", "homes", "injection_min_kw", "kw_per_soc_charged", "kw_per_soc_drawn",
        "slot_cost_a", "slot_cost_b", "slot_cost_c", "soc_per_kw_charged", "soc_per_kw_drawn",
        "stage_before_kw", "stage_max_kw", "stage_min_kw", "value_of_lost_load",
    )  # fmt: skip

    def __init__(self, homes: Homes, facilities: Facilities, dt_h: float, value_of_lost_load: float = 5.0) -> None:
        if not dt_h > 0:
            raise ValueError(f"dt_h = {dt_h}: a slot must last longer than 0 h")
        if np.any(homes.charge_efficiency * homes.discharge_efficiency > 1.0):
            raise ValueError(
                f"charge_efficiency = {homes.charge_efficiency.tolist()}, discharge_efficiency = "
                f"{homes.discharge_efficiency.tolist()}: their product is at most 1 for every home"
            )
        if facilities.count == 0:
            raise ValueError("facilities: at least one generation facility is needed")
        if np.any(facilities.p_min_kw[1:] != 0.0):
            raise ValueError(
                f"facilities.p_min_kw = {facilities.p_min_kw.tolist()}: only the first facility can have a minimum"
            )
        self.homes = homes
        self.facilities = facilities
        self.dt_h = float(dt_h)
        self.value_of_lost_load = float(value_of_lost_load)
        self.battery_min_kw = -homes.discharge_max_kw
        self.injection_min_kw = -homes.injection_max_kw
        # Over one slot: the power at the terminals that fills or empties a whole battery, and the effect of one kW.
        self.kw_per_soc_charged = homes.capacity_kwh / (homes.charge_efficiency * self.dt_h)
        self.kw_per_soc_drawn = homes.capacity_kwh * homes.discharge_efficiency / self.dt_h
        with np.errstate(divide="ignore"):
            self.soc_per_kw_charged = np.where(homes.capacity_kwh > 0.0, 1.0 / self.kw_per_soc_charged, 0.0)
            self.soc_per_kw_drawn = np.where(homes.capacity_kwh > 0.0, 1.0 / self.kw_per_soc_drawn, 0.0)
        # Merit order: the power that all stages before this one can deliver, and the least and most that this one does.
        # The last stage is no facility: it stands for unserved demand.
        self.stage_before_kw = np.concatenate([[0.0], np.cumsum(facilities.p_max_kw)])
        self.stage_min_kw = np.concatenate([facilities.p_min_kw, [0.0]])
        self.stage_max_kw = np.concatenate([facilities.p_max_kw, [np.inf]])
        self.slot_cost_a = facilities.cost_a * self.dt_h
        self.slot_cost_b = facilities.cost_b * self.dt_h
        self.slot_cost_c = facilities.cost_c * self.dt_h

    def with_homes(self, homes: Homes) -> MarketParams:
        """The same market with another set of homes (someone joined or left)."""
        return MarketParams(homes, self.facilities, self.dt_h, self.value_of_lost_load)

    def with_capacity(self, capacity_kwh: ArrayLike) -> MarketParams:
        """The same market with every battery resized, keeping the initial state of charge."""
        size = np.broadcast_to(np.asarray(capacity_kwh, dtype=np.float64), self.homes.capacity_kwh.shape).copy()
        return self.with_homes(replace(self.homes, capacity_kwh=size))
