"""What arrives in messages and over HTTP is what its type says: a number is no text, and neither true nor false."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, get_args

import pytest
from pydantic import BaseModel, ValidationError

from message_schemas import MESSAGES
from zengrid.errors import WireError
from zengrid.scenario import HomeSpec
from zengrid.wire.codec import decode
from zengrid.wire.queries import JoinRequest
from zengrid.wire.spawner_queries import SpawnRequest
from zengrid_gateway.access import Access
from zengrid_gateway.app import create_app
from zengrid_gateway.settings import Settings
from zengrid_gateway.spawners import NewProsumer
from zengrid_gateway.tokens import Tokens

Model = type[BaseModel]


def models_in(annotation: Any) -> Iterator[Model]:
    """All models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from models_in(field.annotation)
    for part in get_args(annotation):
        yield from models_in(part)


def bodies() -> dict[str, Model]:
    """The models of all bodies that the gateway takes, by name."""
    document = create_app(Settings(), Access("nothing", Tokens({}))).openapi()
    operations = [operation for item in document["paths"].values() for operation in item.values()]
    schemas = [
        each["requestBody"]["content"]["application/json"]["schema"] for each in operations if "requestBody" in each
    ]
    names = {schema["$ref"].rpartition("/")[2] for schema in schemas}
    kinds = {kind.__name__: kind for kind in subclasses(BaseModel) if kind.__module__.startswith("zengrid_gateway")}
    return {name: kinds[name] for name in names}


def subclasses(kind: Model) -> Iterator[Model]:
    for each in kind.__subclasses__():
        yield each
        yield from subclasses(each)


def test_whatever_arrives_is_strict_down_to_its_smallest_part() -> None:
    taken = bodies()
    assert set(taken) == {"Control", "NewProsumer", "PolicyQuestion"}
    found = {model for kind in (*MESSAGES, *taken.values()) for model in models_in(kind)}
    assert HomeSpec in found
    assert [model.__name__ for model in found if not model.model_config.get("strict")] == []
    assert [model.__name__ for model in found if model.model_config.get("extra") != "forbid"] == []


WRONG: list[dict[str, Any]] = [
    {"pv_kw": "5"}, {"pv_kw": True}, {"tilt_deg": "30"}, {"injection_max_kw": False}, {"seed": "1"}, {"seed": True},
    {"seed": 1.0}, {"battery": {"capacity_kwh": "10"}}, {"battery": {"soc_max": True}}, {"load": {"scale": "1"}},
    {"load": {"profile": 5}}, {"id": 5},
]  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG, ids=json.dumps)
def test_in_a_home_nothing_is_converted(wrong: dict[str, Any]) -> None:
    home = {"id": "p4", **wrong}
    joining = {"agent": "p4", "role": "prosumer", "instance": "01234567", "homes": [home]}
    for kind, message in ((SpawnRequest, {"home": home}), (JoinRequest, joining)):
        with pytest.raises(WireError, match="Input should be a valid"):
            decode(kind, json.dumps(message).encode())
    for read in (NewProsumer.model_validate, HomeSpec.model_validate):
        with pytest.raises(ValidationError):
            read(home)
    with pytest.raises(ValidationError):
        HomeSpec.model_validate_json(json.dumps(home))


def test_whole_numbers_are_numbers() -> None:
    home = {"id": "p4", "pv_kw": 5, "battery": {"capacity_kwh": 10}, "load": {"scale": 2}}
    wanted = HomeSpec.model_validate(home)
    assert decode(SpawnRequest, json.dumps({"home": home}).encode()).home == wanted
    assert NewProsumer.model_validate(home).pv_kw == 5.0
