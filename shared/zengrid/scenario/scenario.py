"""A complete market as one validated object, as a scenario file describes it."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, ValidationError, field_validator, model_serializer, model_validator
from pydantic import SerializerFunctionWrapHandler as Handler

from zengrid.core.baselines import BASELINE_BUY_PRICE
from zengrid.core.params import Facilities, MarketParams
from zengrid.errors import ScenarioError
from zengrid.scenario.explain import explain
from zengrid.scenario.home_spec import HomeSpec, Id, Spec, homes_params
from zengrid.scenario.noise import Noise
from zengrid.scenario.population import Population
from zengrid.scenario.site import Site
from zengrid.scenario.source import BuiltinData, Data

DAY_MINUTES = 1440

Price = Annotated[float, Field(ge=0.0, le=1000.0)]


class AgentSpec(NamedTuple):
    """A prosumer agent and the ids of its homes, which stand next to each other in the scenario."""

    id: str
    homes: tuple[str, ...]


class TariffStep(Spec):
    """The sell price from a time of day until the next step."""

    start: str = Field(alias="from", pattern=r"^([01]\d|2[0-3]):[0-5]\d$", description="Time of day, HH:MM.")
    price: Price = Field(description="Posted price at which the grid sells [$/kWh].")

    @field_validator("start", mode="before")
    @classmethod
    def _clock(cls, value: object) -> object:
        # YAML reads 11:00 without quotes as the number 660.
        return f"{value // 60:02d}:{value % 60:02d}" if type(value) is int and 0 <= value < DAY_MINUTES else value

    @property
    def minute(self) -> int:
        """Minute of the day. [min]"""
        return 60 * int(self.start[:2]) + int(self.start[3:])


class FacilitySpec(Spec):
    """A generation facility; running it at P kW costs a P^2 + b P + c dollars an hour."""

    name: Id
    min_kw: float = Field(default=0.0, ge=0.0, le=1e9, description="Lowest output; only the first can have one [kW].")
    max_kw: float = Field(ge=0.0, le=1e9, description="Highest output [kW].")
    a: float = Field(default=0.0, ge=0.0, le=1e6, description="Cost that grows with the square of the power [$/kW²h].")
    b: float = Field(ge=0.0, le=1e6, description="Cost of a kilowatt-hour [$/kWh].")
    c: float = Field(default=0.0, ge=0.0, le=1e6, description="Cost of running at all [$/h].")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.max_kw < self.min_kw:
            raise ValueError(f"max_kw = {self.max_kw:g}: permitted from min_kw = {self.min_kw:g} up")
        return self


class ConsumerSpec(Spec):
    """A plain consumer, which buys at the sell price and has nothing to decide."""

    name: Id
    profiles: tuple[str, ...] = Field(min_length=1, description="Load profiles of the data, which are added up.")
    scale: float = Field(default=1.0, ge=0.0, le=1e6, description="Factor on their sum [-].")
    noise_share: float = Field(
        default=1.0,
        ge=0.0,
        le=1.0,
        description="Share of the scenario's load noise; less for many customers together [-].",
    )


class Split(Spec):
    """Days that are reserved for evaluation and never used in training."""

    evaluation_days: int = Field(
        default=10_000, ge=1, le=10**9, description="Of a typical day: number of days from day 0 for evaluation."
    )
    evaluation_months: tuple[Annotated[int, Field(ge=1, le=12)], ...] | None = Field(
        default=None,
        min_length=1,
        max_length=12,
        description="Of measured days: months for evaluation; null: see evaluation_every.",
    )
    evaluation_every: int = Field(
        default=4,
        ge=2,
        le=10_000,
        description="Of measured days without evaluation_months: one of this many days is for evaluation.",
    )


class Scenario(Spec):
    """A complete description of a market. See ``load`` to read one, and ``Days`` for its days."""

    name: Id
    title: str = Field(default="", max_length=200, description="One line for lists.")
    description: str = Field(default="", max_length=10_000, description="Purpose, and the source of the numbers.")
    seed: int = Field(default=0, ge=0, lt=2**63, description="Another seed gives other days, if there is noise.")
    slot_minutes: int = Field(default=60, ge=1, le=DAY_MINUTES, description="Length of a slot; divides the day [min].")
    soc_reset: Literal["daily", "never"] = Field(
        default="never",
        description="`daily` resets stored energy each day (the paper's episodes), `never` carries it over.",
    )
    tariff: tuple[TariffStep, ...] = Field(min_length=1, max_length=DAY_MINUTES, description="Posted sell price.")
    buy_prices: tuple[Price, ...] = Field(
        default=(0.05, 0.06, 0.07, 0.08, 0.09, 0.10),
        min_length=1, max_length=1000, description="Levels at which the grid may buy, increasing [$/kWh].",
    )  # fmt: skip
    baseline_buy_price: Price = Field(
        default=BASELINE_BUY_PRICE, description="Buy price without demand response [$/kWh]."
    )
    battery_levels: int = Field(
        default=5, ge=2, le=1001, description="Commands a learner chooses from, evenly from discharge to charge."
    )
    value_of_lost_load: float = Field(default=5.0, ge=0.0, le=1e6, description="Charge for unserved demand [$/kWh].")
    facilities: tuple[FacilitySpec, ...] = Field(min_length=1, max_length=1000, description="In order of dispatch.")
    homes: tuple[HomeSpec, ...] = Field(default=(), max_length=100_000, description="The prosumers, one by one.")
    population: Population | None = Field(
        default=None, description="The prosumers, drawn from distributions; replaces homes."
    )
    fleets: int | None = Field(
        default=None,
        ge=1,
        le=100_000,
        description="Number of agents fleet1, fleet2, ... that share the homes; null: one agent for each home.",
    )
    consumers: tuple[ConsumerSpec, ...] = Field(
        default=(), max_length=10_000, description="Customers without PV and battery."
    )
    site: Site | None = Field(default=None, description="Place of the market, for PV that is not in the data.")
    data: Data = Field(default_factory=BuiltinData, description="Source of the profiles.")
    noise: Noise = Field(default_factory=Noise, description="Noise between days; `off` for none.")
    split: Split = Field(default_factory=Split, description="Days for evaluation.")

    @field_validator("noise", mode="before")
    @classmethod
    def _off(cls, value: object) -> object:
        # YAML reads off without quotes as false.
        return {} if value is None or value is False or value == "off" else value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if DAY_MINUTES % self.slot_minutes:
            near = [m for m in range(1, DAY_MINUTES + 1) if DAY_MINUTES % m == 0]
            below = max(m for m in near if m < self.slot_minutes)
            above = min(m for m in near if m > self.slot_minutes)
            raise ValueError(
                f"slot_minutes = {self.slot_minutes}: permitted: a divisor of the day's 1440 minutes, "
                f"such as {below} or {above}"
            )
        self._check_tariff()
        if any(low >= high for low, high in pairwise(self.buy_prices)):
            raise ValueError(f"buy_prices = {list(self.buy_prices)}: permitted: increasing prices")
        for facility in self.facilities[1:]:
            if facility.min_kw:
                raise ValueError(
                    f"facilities: {facility.name} has min_kw = {facility.min_kw:g}; permitted: 0 but for the first"
                )
        if self.population is not None:
            if self.homes:
                raise ValueError("homes: given beside population; permitted: one of both")
            object.__setattr__(self, "homes", self.population.homes())
        if not self.homes:
            raise ValueError("homes: none; needed: at least one home, or a population")
        _unique("facilities", [facility.name for facility in self.facilities])
        _unique("homes", [home.id for home in self.homes])
        _unique("consumers", [consumer.name for consumer in self.consumers])
        if "grid" in self.home_ids:
            raise ValueError('homes: id "grid" is that of the grid agent; permitted: any other')
        if self.fleets is not None and self.fleets > len(self.homes):
            raise ValueError(f"fleets = {self.fleets}: permitted: 1 to {len(self.homes)}, the number of homes")
        return self

    def _check_tariff(self) -> None:
        if self.tariff[0].minute:
            raise ValueError(f'tariff: begins at {self.tariff[0].start}; needed: a price from "00:00" on')
        for step, after in pairwise(self.tariff):
            if after.minute <= step.minute:
                raise ValueError(f"tariff: {after.start} after {step.start}; permitted: increasing times")
        for step in self.tariff:
            if step.minute % self.slot_minutes:
                raise ValueError(
                    f"tariff: {step.start} lies within a slot; permitted: multiples of {self.slot_minutes} min"
                )

    @model_serializer(mode="wrap")
    def _undrawn(self, handler: Handler) -> dict[str, Any]:
        fields: dict[str, Any] = handler(self)
        return {name: value for name, value in fields.items() if name not in self.drawn}

    @property
    def drawn(self) -> set[str]:
        """Fields that follow from others: ``homes`` if they are drawn from a population."""
        return set() if self.population is None else {"homes"}

    @property
    def dt_h(self) -> float:
        """Length of a slot. [h]"""
        return self.slot_minutes / 60.0

    @property
    def slots_per_day(self) -> int:
        """Number of slots of a day."""
        return DAY_MINUTES // self.slot_minutes

    @cached_property
    def home_ids(self) -> tuple[str, ...]:
        """Ids of the homes, in the order of all arrays."""
        return tuple(home.id for home in self.homes)

    @cached_property
    def agents(self) -> tuple[AgentSpec, ...]:
        """Agents of the homes: one for each home, or fleets of neighbouring homes of nearly equal size."""
        ids, fleets = self.home_ids, self.fleets
        if fleets is None:
            return tuple(AgentSpec(home, (home,)) for home in ids)
        edges = [len(ids) * i // fleets for i in range(fleets + 1)]
        return tuple(AgentSpec(f"fleet{i + 1}", ids[a:b]) for i, (a, b) in enumerate(pairwise(edges)))

    @cached_property
    def sell_prices(self) -> tuple[float, ...]:
        """The posted sell price of each slot of the day. [$/kWh]"""
        starts = range(0, DAY_MINUTES, self.slot_minutes)
        return tuple(next(s.price for s in reversed(self.tariff) if s.minute <= start) for start in starts)

    def market(self) -> MarketParams:
        """The homes, facilities and slot length in the form that the core uses."""
        facilities = Facilities.of(
            p_min_kw=[f.min_kw for f in self.facilities],
            p_max_kw=[f.max_kw for f in self.facilities],
            cost_a=[f.a for f in self.facilities],
            cost_b=[f.b for f in self.facilities],
            cost_c=[f.c for f in self.facilities],
        )
        return MarketParams(homes_params(self.homes), facilities, self.dt_h, self.value_of_lost_load)

    def with_(self, **changes: Any) -> Scenario:
        """Return the scenario with some fields changed, validated.

        Parameters
        ----------
        **changes:
            New values by field. Dots separate the fields of a path, and ``*`` means all members of a list:
            ``with_(seed=3, noise="off")``, ``with_(**{"homes.*.battery.capacity_kwh": 10})``.

        Raises
        ------
        ScenarioError
            A field is invalid; the message names it, its value and what is permitted.
        """
        fields = self.model_dump(by_alias=True, exclude=self.drawn)
        if self.population is not None and any(path.split(".")[0] == "homes" for path in changes):
            # Homes that are changed individually are no longer drawn.
            fields |= {"homes": [home.model_dump() for home in self.homes], "population": None}
        for path, value in changes.items():
            _change(fields, path.split("."), path, value)
        try:
            return Scenario.model_validate(fields)
        except ValidationError as error:
            raise ScenarioError(explain(error, fields, Scenario.model_json_schema(by_alias=True))) from None


def _unique(field: str, names: list[str]) -> None:
    if len(set(names)) != len(names):
        double = next(name for position, name in enumerate(names) if name in names[:position])
        raise ValueError(f'{field}: "{double}" appears twice; permitted: once')


def _change(fields: Any, steps: list[str], path: str, value: object) -> None:
    step, rest = steps[0], steps[1:]
    if isinstance(fields, (list, tuple)):
        chosen = range(len(fields)) if step == "*" else [int(step)] if step.isdecimal() else []
        if not chosen or chosen[-1] >= len(fields):
            raise ScenarioError(f"{path}: there is no member {step}; permitted: 0 to {len(fields) - 1}, or *")
        keys: list[Any] = list(chosen)
    elif isinstance(fields, dict):
        keys = [step]
    else:
        raise ScenarioError(f"{path}: {step} is inside a single value; permitted: the path of a field")
    for key in keys:
        if not rest:
            fields[key] = value
            continue
        if isinstance(fields, dict) and fields.get(key) is None:
            fields[key] = {}
        if isinstance(fields[key], tuple):
            fields[key] = list(fields[key])
        _change(fields[key], rest, path, value)
