"""What is wrong with a request, field by field: pydantic's errors in the words of the document."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, Field

Error = Mapping[str, Any]
Place = tuple[str | int, ...]
Schema = Mapping[str, Any]

NAMED = re.compile(r"(?:\w+ [\w-]+: )?([\w.]+) = (.*?): (.+)", re.DOTALL)
"""How the other side says what is wrong: (home p4:) name = value: what is allowed."""


class FieldError(BaseModel):
    """One field of a request that cannot be used."""

    field: str = Field(description="Where it stands, such as `body.battery.capacity_kwh`.")
    value: Any = Field(default=None, description="What was sent.")
    allowed: str = Field(description="What is allowed.")


def explain(errors: Sequence[Error], body: object, names: Callable[[Place], Sequence[str]]) -> list[FieldError]:
    """Each field once, with all that is allowed there.

    Parameters
    ----------
    errors:
        As FastAPI has found them.
    body:
        What was sent. Where a field may be one of several things, pydantic names the thing,
        too, and finds fault with each.
    names:
        Tells what fields there are beside one that does not exist.
    """
    found: dict[Place, FieldError] = {}
    for error in errors:
        place = _place(error, body)
        allowed = str(error["msg"]).removeprefix("Value error, ")
        if error["type"] == "json_invalid":
            place, allowed = ("body",), f"JSON; at character {error['loc'][-1]}: {error['ctx']['error']}"
        elif error["type"] == "extra_forbidden":
            allowed = f"there is no such field; there are {', '.join(names(place)) or 'none'}"
        known = found.get(place)
        if known is None:
            found[place] = FieldError(
                field=".".join(map(str, place)), value=_shown(error.get("input")), allowed=allowed
            )
        elif allowed not in known.allowed:
            known.allowed = f"{known.allowed}; or: {allowed}"
    # What is wrong inside a list says more than that the list is no number.
    return [
        error
        for place, error in found.items()
        if not any(len(other) > len(place) and other[: len(place)] == place for other in found)
    ]


def told(text: str, *, inside: str = "") -> list[FieldError]:
    """The field that the market names when it refuses, if it names one."""
    match = NAMED.fullmatch(text)
    return [FieldError(field=inside + match[1], value=match[2][:200], allowed=match[3])] if match else []


def fields(document: Schema, path: str, method: str, place: Place) -> list[str]:
    """The names that a route's document has where a field stands."""
    operation = document["paths"].get(path, {}).get(method.lower(), {})
    if place[0] != "body":
        return [each["name"] for each in operation.get("parameters", []) if each["in"] == place[0]]
    schema = operation["requestBody"]["content"]["application/json"]["schema"]
    for part in place[1:-1]:
        schema = _object(schema, document).get("properties", {}).get(part, {})
    return list(_object(schema, document).get("properties", {}))


def _object(schema: Schema, document: Schema) -> Schema:
    """What a schema says of objects."""
    if "$ref" in schema:
        return _object(document["components"]["schemas"][schema["$ref"].rpartition("/")[2]], document)
    branches = [_object(each, document) for each in schema.get("anyOf", ())]
    return next((each for each in branches if "properties" in each), schema)


def _place(error: Error, body: object) -> Place:
    """Where it stands in the request: pydantic's place without the names of alternatives."""
    origin, *parts = error["loc"]
    if origin != "body":
        return (origin, *parts)
    place: Place = (origin,)
    here = body
    for part in parts:
        if isinstance(here, dict | list) and part in (here if isinstance(here, dict) else range(len(here))):
            here = here[part]
        elif error["type"] != "missing" or part != parts[-1]:
            continue  # the name of an alternative
        place = (*place, part)
    return place


def _shown(value: Any) -> Any:
    """What was sent, cut to a length that fits an answer."""
    text = repr(value)
    return value if len(text) <= 200 and isinstance(value, str | int | float | bool | None) else text[:200]
