"""Each struct that is read in every slot has the fields, types and defaults of its pydantic model."""

from __future__ import annotations

import inspect
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
from pydantic import BaseModel

from zengrid.wire import slot_structs, slots
from zengrid.wire.slot_structs import SlotStruct

STRUCTS = [
    it
    for _, it in inspect.getmembers(slot_structs, inspect.isclass)
    if issubclass(it, SlotStruct) and it is not SlotStruct
]
STRUCT_OF = {struct.model: struct for struct in STRUCTS}


def plain(annotation: Any) -> Any:
    """The type of a model's field as its struct should declare it: without limits, and columns as lists."""
    if annotation in STRUCT_OF:
        return STRUCT_OF[annotation]
    if get_origin(annotation) is Annotated:
        return plain(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        members = [plain(member) for member in get_args(annotation) if get_origin(member) is not np.ndarray]
        return Union[tuple(members)]  # noqa: UP007 - built from what is found
    assert annotation in (str, int, float, bool, NoneType, list[float]) or get_origin(annotation) is Literal, annotation
    return annotation


def fields_of_struct(struct: type[SlotStruct]) -> dict[str, tuple[Any, Any]]:
    types = get_type_hints(struct)
    return {
        field.name: (types[field.name], "required" if field.required else field.default)
        for field in msgspec.structs.fields(struct)
    }


def fields_of_model(model: type[BaseModel]) -> dict[str, tuple[Any, Any]]:
    return {
        name: (plain(field.annotation), "required" if field.is_required() else field.default)
        for name, field in model.model_fields.items()
    }


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_a_struct_has_the_fields_types_and_defaults_of_its_model(struct: type[SlotStruct]) -> None:
    assert struct.__name__ == f"{struct.model.__name__}Struct"
    assert fields_of_struct(struct) == fields_of_model(struct.model)
    assert list(fields_of_struct(struct)) == list(fields_of_model(struct.model))


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_a_struct_is_read_only_and_refuses_unknown_fields(struct: type[SlotStruct]) -> None:
    assert struct.__struct_config__.frozen
    assert struct.__struct_config__.forbid_unknown_fields


def test_every_observation_action_and_settled_part_has_a_struct() -> None:
    names = ("Observation", "Action", "Settled")
    models = {it for _, it in inspect.getmembers(slots, inspect.isclass) if it.__name__.endswith(names)}
    assert models == set(STRUCT_OF)
    assert len(models) == 6
