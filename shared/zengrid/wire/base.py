"""What all messages share: strictness, version, identifiers, and columns of numbers as numpy arrays."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler
from pydantic_core import core_schema

from zengrid.scenario.home_spec import Printable

MAX_HOMES = 100_000
"""Most homes one message may carry."""

AgentId = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$", description="Name of an agent or home.")]
RunName = Annotated[
    str, Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,62}$", description="Name of the run, part of every key.")
]
Instance = Annotated[
    Printable,
    Field(
        min_length=8,
        max_length=64,
        description="Random text that a process chooses, so that a second one under its name is told apart.",
    ),
]
Price = Annotated[float, Field(ge=0, le=1000, description="[$/kWh]")]


# The first wrong number is enough: a message of nothing but errors must not cost more than a good one.
_NUMBERS = core_schema.list_schema(
    core_schema.float_schema(allow_inf_nan=False, strict=True), max_length=MAX_HOMES, fail_fast=True
)
_IS_ARRAY = core_schema.is_instance_schema(np.ndarray)


class _AsArray:
    """A float64 array in Python, a list of finite numbers in JSON."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        from_list = core_schema.no_info_after_validator_function(_to_array, _NUMBERS)
        return core_schema.json_or_python_schema(
            json_schema=from_list,
            python_schema=core_schema.union_schema([_IS_ARRAY, from_list]),
            serialization=core_schema.plain_serializer_function_ser_schema(np.ndarray.tolist, return_schema=_NUMBERS),
        )


class _AsReceived:
    """The same on the wire, but what came as a list stays one: most agents use few of their columns."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        return core_schema.json_or_python_schema(
            json_schema=_NUMBERS,
            python_schema=core_schema.union_schema([_IS_ARRAY, _NUMBERS]),
            serialization=core_schema.plain_serializer_function_ser_schema(_to_list, return_schema=_NUMBERS),
        )


def _to_array(values: list[float]) -> NDArray[np.float64]:
    return np.array(values, dtype=np.float64)


def _to_list(values: list[float] | NDArray[np.float64]) -> list[float]:
    return values if isinstance(values, list) else values.tolist()


_DESCRIBED = Field(description="One number per home, in the order of the join reply.")
Column = Annotated[NDArray[np.float64], _AsArray, _DESCRIBED]
"""One number per home: an array in Python, a list in JSON."""
SlotColumn = Annotated[list[float] | NDArray[np.float64], _AsReceived, _DESCRIBED]
"""The same in the messages of every slot: a list or an array as it came; use ``numpy.asarray``."""


class Message(BaseModel):
    """A message: frozen, unknown fields refused, numbers finite, with a schema version."""

    # Most processes use few of the messages: each is built when it is first needed.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True, defer_build=True)

    v: Literal[1] = Field(default=1, description="Schema version.")


class SlotMessage(Message):
    """A message that belongs to one slot of one run."""

    run: RunName
    day: int = Field(ge=0, description="Day of the run, from 0.")
    slot: int = Field(ge=0, description="Slot of the day, from 0.")
