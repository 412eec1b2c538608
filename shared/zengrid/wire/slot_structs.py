"""Observations and actions as msgspec structs: what ``codec.read`` returns in every slot.

The pydantic models in ``zengrid.wire.slots`` are the schema. msgspec decodes the same JSON in a third of the time, but
checks only fields and types, not limits. Each struct names its model; a test compares fields, types and defaults.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal, Self

import msgspec

from zengrid.wire import slots
from zengrid.wire.base import Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Numbers = list[float] | NDArray[np.float64]
else:
    Numbers = list[float]
"""One number per home or facility: a list when read from JSON, an array when read from the binary encoding."""


class SlotStruct(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all structs: read-only, unknown fields refused, with the schema version."""

    model: ClassVar[type[Message]]
    """The pydantic model of the same message."""

    v: Literal[1] = 1

    @classmethod
    def of(cls, message: Message) -> Self:
        """Copy the fields of a message that pydantic has validated, an instance of ``model``."""
        fields = dict(vars(message))
        if (settled := fields.get("settled")) is not None:
            fields["settled"] = _SETTLED[type(settled)].of(settled)
        return cls(**fields)


class GridSettledStruct(SlotStruct, frozen=True, kw_only=True):
    """``GridSettled``: result of the grid agent's previous slot."""

    model = slots.GridSettled

    day: int
    slot: int
    buy_price: float
    reward: float
    fallback: bool


class GridObservationStruct(SlotStruct, frozen=True, kw_only=True):
    """``GridObservation``: what the grid agent sees before it sets a price."""

    model = slots.GridObservation

    run: str
    day: int
    slot: int
    phase: Literal["price", "end"] = slots.PHASE_PRICE
    hour: float
    deadline_s: float
    sell_price: float
    homes: int
    facility_cost: Numbers
    payment: Numbers | None
    payments: float
    demand_kw: float
    settled: GridSettledStruct | None


class GridActionStruct(SlotStruct, frozen=True, kw_only=True):
    """``GridAction``: the price at which the grid buys."""

    model = slots.GridAction

    run: str
    day: int
    slot: int
    phase: Literal["price"] = slots.PHASE_PRICE
    instance: str
    buy_price: float


class FleetSettledStruct(SlotStruct, frozen=True, kw_only=True):
    """``FleetSettled``: result of the previous slot for an agent's homes."""

    model = slots.FleetSettled

    day: int
    slot: int
    buy_price: float
    reward: Numbers
    battery_kw: Numbers
    injection_kw: Numbers
    fallback: bool


class FleetObservationStruct(SlotStruct, frozen=True, kw_only=True):
    """``FleetObservation``: what a prosumer agent sees before it commands its batteries."""

    model = slots.FleetObservation

    run: str
    day: int
    slot: int
    phase: Literal["battery", "end"] = slots.PHASE_BATTERY
    hour: float
    deadline_s: float
    buy_price: float
    sell_price: float
    soc: Numbers
    pv_kw: Numbers
    load_kw: Numbers
    settled: FleetSettledStruct | None


class FleetActionStruct(SlotStruct, frozen=True, kw_only=True):
    """``FleetAction``: one command per home."""

    model = slots.FleetAction

    run: str
    day: int
    slot: int
    phase: Literal["battery"] = slots.PHASE_BATTERY
    instance: str
    battery_kw: Numbers


_SETTLED: dict[type[Message], type[SlotStruct]] = {
    slots.GridSettled: GridSettledStruct,
    slots.FleetSettled: FleetSettledStruct,
}
