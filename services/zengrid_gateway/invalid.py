"""What is wrong with a request, field by field: pydantic's errors in the words of the document."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, Field

Error = Mapping[str, Any]
Place = tuple[str | int, ...]
Schema = Mapping[str, Any]

EXPLAINED = 20
"""Most fields explained in one answer."""
ALTERNATIVES = 10
"""Most errors used to explain one field."""
SHOWN = 200
"""Longest text of a field's name or value. [characters]"""
ALLOWED = 1000
"""Longest text of what is allowed. [characters]"""

NAMED = re.compile(r"(?:\w+ [\w-]+: )?([\w.]+) = (.*?): (.+)", re.DOTALL)
"""How the other side says what is wrong: (home p4:) name = value: what is allowed."""

_JSON = json.JSONEncoder(ensure_ascii=False, default=repr)


def short(text: str, longest: int = SHOWN) -> str:
    """A text, cut where it is longer."""
    return text if len(text) <= longest else f"{text[: longest - 3]}..."


def shown(value: Any) -> Any:
    """What was sent, cut to a length that fits an answer; lists and objects as JSON text.

    Encodes no more of a list or an object than it shows: the value can be the whole body, once for each error.
    """
    match value:
        case str():
            return short(value)
        case None | bool():
            return value
        case int():
            return value if abs(value) < 2**63 else short(str(value))
        case float():
            return value if math.isfinite(value) else str(value)
    text = ""
    for part in _JSON.iterencode(value):
        text += part[: SHOWN + 1]
        if len(text) > SHOWN:
            break
    return short(text)


class FieldError(BaseModel):
    """One field of a request that cannot be used."""

    field: Annotated[str, AfterValidator(lambda text: short(text))] = Field(
        description="Where it stands, such as `body.battery.capacity_kwh`."
    )
    value: Annotated[Any, BeforeValidator(shown)] = Field(
        default=None, description="What was sent; long texts, lists and objects are cut."
    )
    allowed: Annotated[str, AfterValidator(lambda text: short(text, ALLOWED))] = Field(description="What is allowed.")


def explain(
    errors: Sequence[Error], body: object, names: Callable[[Place], Sequence[str]]
) -> tuple[list[FieldError], int]:
    """Explain the first invalid fields, each once with all that is allowed there, and count the others.

    Takes time linear in the number of errors.

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
    found: dict[Place, list[Error]] = {}
    for error in errors:
        found.setdefault(_place(error, body), []).append(error)
    # What is wrong inside a list says more than that the list is no number.
    outer = {place[:depth] for place in found for depth in range(len(place))}
    wrong = [place for place in found if place not in outer]
    explained = [_explain(place, found[place], names) for place in wrong[:EXPLAINED]]
    return explained, len(wrong) - len(explained)


def told(text: str, *, inside: str = "") -> list[FieldError]:
    """The field that the market names when it refuses, if it names one."""
    match = NAMED.fullmatch(text[: 2 * ALLOWED])
    return [FieldError(field=inside + match[1], value=match[2], allowed=match[3])] if match else []


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
    place = [origin]
    here = body
    for part in parts:
        if (isinstance(here, dict) and part in here) or (
            isinstance(here, list) and isinstance(part, int) and part < len(here)
        ):
            here = here[part]
        elif error["type"] != "missing" or part != parts[-1]:
            continue  # the name of an alternative
        place.append(part)
    return tuple(place)


def _explain(place: Place, errors: Sequence[Error], names: Callable[[Place], Sequence[str]]) -> FieldError:
    """All that is allowed in one field."""
    allowed = dict.fromkeys(_allowed(place, error, names) for error in errors[:ALTERNATIVES])
    return FieldError(
        field=".".join(short(str(part)) for part in place), value=errors[0].get("input"), allowed="; or: ".join(allowed)
    )


def _allowed(place: Place, error: Error, names: Callable[[Place], Sequence[str]]) -> str:
    if error["type"] == "extra_forbidden":
        return f"there is no such field; there are {', '.join(names(place)) or 'none'}"
    return str(error["msg"]).removeprefix("Value error, ")
