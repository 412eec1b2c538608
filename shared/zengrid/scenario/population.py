"""Draws homes from distributions, to describe large markets in a few lines; the same seed gives the same homes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from zengrid.scenario.home_spec import SMALLEST, BatterySpec, HomeSpec, LoadSpec, Spec
from zengrid.scenario.randomness import RandomKeys, bell, fork, keys_of, uniform

T = TypeVar("T")

# The sum of four uniform numbers is within 2 sqrt(3) standard deviations of its mean.
_BELL_WIDTH = 4.0 * 3.0**0.5
_UNBOUNDED = ("pv_kw", "battery_kwh", "load_scale")


class Draw(Spec):
    """A distribution: numbers between two bounds, or values by weight."""

    min: float | None = Field(default=None, description="Lowest value.")
    max: float | None = Field(default=None, description="Highest value.")
    shape: Literal["flat", "bell"] = Field(default="bell", description="Uniform, or mostly near the middle.")
    step: float = Field(default=0.0, ge=0.0, description="Round to multiples of this; 0 does not round.")
    weights: dict[float, float] | None = Field(default=None, description="Value: weight, instead of min and max.")

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.weights is None) == (self.min is None) or (self.min is None) != (self.max is None):
            raise ValueError("permitted: min and max, or weights")
        if self.min is not None and self.max is not None and self.max < self.min:
            raise ValueError(f"max = {self.max:g}: permitted from min = {self.min:g} up")
        if self.weights is not None:
            _check_weights(self.weights, "weights")
        return self

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest value that can be drawn."""
        values = (self.min, self.max) if self.weights is None else tuple(self.weights)
        given = [value for value in values if value is not None]
        return min(given), max(given)

    def draw(self, keys: RandomKeys) -> list[float]:
        """Draw one value for each key."""
        if self.weights is not None:
            return choose(self.weights, keys)
        low, high = self.bounds
        share = uniform(keys) if self.shape == "flat" else 0.5 + bell(keys) / _BELL_WIDTH
        values = low + (high - low) * share
        if self.step > 0.0:
            values = np.round(values / self.step) * self.step
        return [round(value, 9) for value in np.minimum(np.maximum(values, low), high).tolist()]


class Population(Spec):
    """A number of homes, each with its own draw of PV, battery and load."""

    count: int = Field(ge=1, le=100_000, description="Number of homes.")
    prefix: str = Field(default="h", pattern=r"^[a-z][a-z0-9_-]{0,15}$", description="Ids are the prefix and a number.")
    seed: int = Field(default=1, ge=0, lt=2**63, description="Another seed draws other homes.")
    pv_kw: Draw = Field(description="Rated PV power [kW].")
    tilt_deg: Draw = Field(description="Slope of the panels [deg].")
    azimuth_deg: Draw = Field(description="Direction of the panels, 180 is south [deg].")
    battery_kwh: Draw = Field(description="Battery capacity; 0 is none [kWh].")
    battery_c_rate: float = Field(default=0.4, gt=0.0, le=100.0, description="Battery power per capacity [1/h].")
    soc_min: float = Field(default=0.1, ge=0.0, le=1.0, description="Lowest permitted state of charge [-].")
    soc_max: float = Field(default=0.9, ge=0.0, le=1.0, description="Highest permitted state of charge [-].")
    charge_efficiency: float = Field(default=1.0, ge=0.01, le=1.0, description="Of all batteries [-].")
    discharge_efficiency: float = Field(default=1.0, ge=0.01, le=1.0, description="Of all batteries [-].")
    injection_max_kw: float = Field(default=10.0, ge=0.0, le=1e6, description="Limit of the meters [kW].")
    load_profiles: dict[str, float] = Field(min_length=1, description="Load profile: weight.")
    load_scale: Draw = Field(description="Factor on the load profile.")

    @model_validator(mode="after")
    def _permitted(self) -> Self:
        _check_weights(self.load_profiles, "load_profiles")
        for name, top in (("tilt_deg", 90.0), ("azimuth_deg", 360.0), *((name, 1e6) for name in _UNBOUNDED)):
            for value in getattr(self, name).bounds:
                if not 0.0 <= value <= top:
                    raise ValueError(f"{name}: {value:g} can be drawn; permitted: 0 to {top:g}")
        if self.soc_min > self.soc_max:
            raise ValueError(f"soc_min = {self.soc_min:g}: permitted 0 to soc_max = {self.soc_max:g}")
        return self

    def homes(self) -> tuple[HomeSpec, ...]:
        """Draw the homes; the number of homes does not change any of them."""
        names = [f"{self.prefix}{i + 1:0{len(str(self.count))}d}" for i in range(self.count)]
        places = np.arange(self.count)

        def keys(purpose: str) -> RandomKeys:
            return fork(keys_of([purpose], self.seed), places)

        columns = zip(
            names,
            self.pv_kw.draw(keys("pv_kw")),
            self.tilt_deg.draw(keys("tilt_deg")),
            self.azimuth_deg.draw(keys("azimuth_deg")),
            self.battery_kwh.draw(keys("battery_kwh")),
            choose(self.load_profiles, keys("load_profile")),
            self.load_scale.draw(keys("load_scale")),
            strict=True,
        )
        return tuple(
            HomeSpec(
                id=name,
                pv_kw=pv_kw,
                tilt_deg=tilt_deg,
                azimuth_deg=azimuth_deg,
                battery=self._battery(capacity_kwh),
                injection_max_kw=self.injection_max_kw,
                load=LoadSpec(profile=profile, scale=scale),
            )
            for name, pv_kw, tilt_deg, azimuth_deg, capacity_kwh, profile, scale in columns
        )

    def _battery(self, capacity_kwh: float) -> BatterySpec:
        if capacity_kwh < SMALLEST:
            capacity_kwh = 0.0
        power_kw = round(self.battery_c_rate * capacity_kwh, 9)
        if power_kw < SMALLEST:
            power_kw = 0.0
        return BatterySpec(
            capacity_kwh=capacity_kwh,
            charge_max_kw=power_kw,
            discharge_max_kw=power_kw,
            soc_min=self.soc_min,
            soc_max=self.soc_max,
            charge_efficiency=self.charge_efficiency,
            discharge_efficiency=self.discharge_efficiency,
        )


def choose(weights: Mapping[T, float], keys: RandomKeys) -> list[T]:
    """Choose one of the values for each key, with probability in proportion to its weight."""
    edges = np.cumsum(np.array(list(weights.values())))
    values = list(weights)
    return [values[place] for place in np.searchsorted(edges, uniform(keys) * edges[-1], side="right").tolist()]


def _check_weights(weights: Mapping[T, float], field: str) -> None:
    for value, weight in weights.items():
        if not weight >= 0.0:
            raise ValueError(f"{field}.{value} = {weight:g}: permitted from 0 up")
    if not sum(weights.values()) > 0.0:
        raise ValueError(f"{field}: permitted: at least one weight above 0")
