"""The published schemas are those of the code."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np

from message_schemas import documents, json_schema
from zengrid.wire.codec import encode
from zengrid.wire.slots import FleetAction

PUBLISHED = Path(__file__).parents[2] / "docs" / "protocol"


def test_published_schemas_are_up_to_date() -> None:
    generated = documents()
    published = {str(path.relative_to(PUBLISHED)): path.read_text() for path in PUBLISHED.rglob("*.json")}
    assert published == generated, "run: make schemas"


def test_schemas_accept_what_the_code_writes() -> None:
    action = FleetAction(run="main", day=0, slot=0, instance="01234567", battery_kw=np.array([1.5, -2.0]))
    jsonschema.validate(json.loads(encode(action)), json_schema(FleetAction))
