"""Describes one home, for scenario files and joining agents: PV, battery, load, meter."""

from __future__ import annotations

from collections.abc import Sequence
from operator import attrgetter
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from zengrid.core.params import HOME_FIELDS, Homes

Id = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$", description="Lower-case name, unique among its kind.")]


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("permitted are printable characters")
    return text


PRINTABLE = r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*$"
"""What a schema can say of printable text: no control characters, and no other ends of a line."""
Printable = Annotated[str, AfterValidator(_printable), Field(json_schema_extra={"pattern": PRINTABLE})]
"""Text that a line of a log or a terminal can show, and a process be started with."""
SMALLEST = 1e-3
"""Smallest battery capacity and power other than 0. [kWh], [kW]"""


class Spec(BaseModel):
    """Part of a scenario: frozen, unknown fields refused, numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True, defer_build=True)


class StrictSpec(Spec):
    """A part that also arrives in messages, where a number must be a number: no text, and neither true nor false."""

    model_config = ConfigDict(strict=True)


class BatterySpec(StrictSpec):
    """A home's battery. The defaults, except the capacity, are those of the paper."""

    capacity_kwh: float = Field(
        default=0.0, ge=0.0, le=1e6, description="Capacity: 0 is a home without battery, else at least 0.001 [kWh]."
    )
    charge_max_kw: float = Field(default=2.0, ge=0.0, le=1e6, description="Largest charging power [kW].")
    discharge_max_kw: float = Field(default=2.0, ge=0.0, le=1e6, description="Largest discharging power [kW].")
    soc_min: float = Field(default=0.1, ge=0.0, le=1.0, description="Lowest permitted state of charge [-].")
    soc_max: float = Field(default=0.9, ge=0.0, le=1.0, description="Highest permitted state of charge [-].")
    charge_efficiency: float = Field(default=1.0, ge=0.01, le=1.0, description="Energy stored per energy taken in [-].")
    discharge_efficiency: float = Field(
        default=1.0, ge=0.01, le=1.0, description="Energy delivered per energy taken out [-]."
    )
    initial_kwh: float | None = Field(
        default=None, ge=0.0, le=1e6, description="Stored energy at the start; null is half the capacity [kWh]."
    )

    @field_validator("capacity_kwh", "charge_max_kw", "discharge_max_kw")
    @classmethod
    def _computable(cls, value: float, info: ValidationInfo) -> float:
        # Powers and capacities are divided by each other; tiny numbers would overflow.
        if 0.0 < value < SMALLEST:
            raise ValueError(f"{info.field_name} = {value:g}: permitted: 0, or {SMALLEST:g} to 1e+06")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.soc_min > self.soc_max:
            raise ValueError(f"soc_min = {self.soc_min:g}: permitted 0 to soc_max = {self.soc_max:g}")
        low, high = self.soc_min * self.capacity_kwh, self.soc_max * self.capacity_kwh
        if self.initial_kwh is not None and not low <= self.initial_kwh <= high:
            raise ValueError(
                f"initial_kwh = {self.initial_kwh:g}: permitted {low:g} to {high:g} kWh "
                f"(soc_min to soc_max of capacity_kwh = {self.capacity_kwh:g})"
            )
        return self

    @property
    def soc_initial(self) -> float:
        """State of charge at the start, within its limits. [-]"""
        wanted = 0.5 if self.initial_kwh is None or self.capacity_kwh == 0.0 else self.initial_kwh / self.capacity_kwh
        return min(max(wanted, self.soc_min), self.soc_max)


class LoadSpec(StrictSpec):
    """A home's consumption: a named profile of the scenario's data, scaled."""

    profile: Printable | None = Field(
        default=None, max_length=200, description="Load profile of the scenario's data; null: that of its first home."
    )
    scale: float = Field(default=1.0, ge=0.0, le=1e6, description="Factor on the profile [-].")


class HomeSpec(StrictSpec):
    """A prosumer's home, such as ``HomeSpec(id="p4", pv_kw=5, battery={"capacity_kwh": 10})``."""

    id: Id
    pv_kw: float = Field(default=0.0, ge=0.0, le=1e6, description="Rated power of the PV system [kW].")
    tilt_deg: float | None = Field(
        default=None, ge=0.0, le=90.0, description="Slope of the panels, 0 is flat; null: see the scenario's PV [deg]."
    )
    azimuth_deg: float | None = Field(
        default=None,
        ge=0.0,
        le=360.0,
        description="Direction of the panels, 180 is south; null: see the scenario's PV [deg].",
    )
    battery: BatterySpec = Field(default_factory=BatterySpec, description="Its battery.")
    injection_max_kw: float = Field(
        default=10.0, ge=0.0, le=1e6, description="Limit of the meter in both directions [kW]."
    )
    load: LoadSpec = Field(default_factory=LoadSpec, description="Its consumption.")
    seed: int = Field(default=0, ge=0, lt=2**63, description="Changes only the home's own noise.")


_home_values = attrgetter(*(name if name in HomeSpec.model_fields else f"battery.{name}" for name in HOME_FIELDS))
"""Reads the fields of ``Homes``: a home has them itself or in its battery."""


def home_columns(home: HomeSpec) -> dict[str, float]:
    """The values of one home for the fields of ``Homes``, by name."""
    return dict(zip(HOME_FIELDS, _home_values(home), strict=True))


def homes_params(homes: Sequence[HomeSpec]) -> Homes:
    """The homes' batteries and meters as arrays for the core, in the given order."""
    rows = np.array([_home_values(home) for home in homes], dtype=np.float64).reshape(len(homes), len(HOME_FIELDS))
    return Homes.from_columns(dict(zip(HOME_FIELDS, rows.T, strict=True)))
