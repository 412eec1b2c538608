"""Describes pydantic's errors in one line each: field, value, permitted values, and the line in the file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import ValidationError

from zengrid.scenario.home_spec import PRINTABLE
from zengrid.validation import FieldPath, field_name, short_value

JsonSchema = Mapping[str, Any]

_SHOWN = 10


def explain(
    error: ValidationError, given: object, schema: JsonSchema, line_of: Callable[[FieldPath], int | None] | None = None
) -> str:
    """Describe each wrong field in one line.

    Parameters
    ----------
    error:
        The error that pydantic raised for a scenario.
    given:
        The fields that were validated.
    schema:
        The scenario's JSON schema, by alias.
    line_of:
        Returns the line of the file that holds a field; None if there is no file.
    """
    lines: dict[FieldPath, str] = {}
    for finding in error.errors(include_url=False):
        place = _place(finding["loc"], given, missing=finding["type"] == "missing")
        text, at = _describe(finding, place, schema, given)
        line = line_of(at) if line_of is not None else None
        lines.setdefault(at, text if line is None else f"line {line}: {text}")
    # A union of a single value and a mapping reports both the field and its members. Keep the members.
    outer = {at[:depth] for at in lines for depth in range(len(at))}
    lines = {at: text for at, text in lines.items() if at not in outer}
    shown = list(lines.values())[:_SHOWN]
    if len(lines) > _SHOWN:
        shown.append(f"and {len(lines) - _SHOWN} more")
    return "\n".join(shown)


def _place(loc: Sequence[str | int], given: object, *, missing: bool) -> FieldPath:
    """The path of a field in the file; pydantic's own path also names the member of a union that it tried."""
    place: list[str | int] = []
    for position, step in enumerate(loc):
        inside = _member(given, step)
        if inside is not None or (isinstance(given, Mapping) and step in given):
            place.append(step)
            given = inside
        elif missing and position == len(loc) - 1:
            place.append(step)
    return tuple(place)


def _describe(finding: Any, place: FieldPath, schema: JsonSchema, given: object) -> tuple[str, FieldPath]:
    """Text about one error, and the path of its field."""
    kind, path = finding["type"], field_name(place)
    if kind == "value_error":
        message = finding["msg"].removeprefix("Value error, ")
        if not path or message.startswith("permitted"):
            return f"{path}: {message}".removeprefix(": "), (*place, *_named(message))
        return f"{path}.{message}", (*place, *_named(message))
    if kind == "union_tag_not_found":
        return f"{path}.kind: missing; needed: {_permitted(place, schema, given)}", place
    if kind == "missing":
        return f"{path}: missing; needed: {_permitted(place, schema, given)}", place
    if kind == "extra_forbidden":
        fields = _fields(_at(place[:-1], schema, given))
        return f"{path}: there is no such field; permitted: {', '.join(fields)}", place
    value = given
    for step in place:
        value = _member(value, step)
    if kind == "union_tag_invalid" and isinstance(value, Mapping):
        return f"{path}.kind = {short_value(value['kind'])}; permitted: {_permitted(place, schema, given)}", (
            *place,
            "kind",
        )
    return f"{path or 'scenario'} = {short_value(value)}: permitted: {_permitted(place, schema, given)}", place


def _named(message: str) -> FieldPath:
    """The field with which a validator's message begins."""
    found = re.match(r"[a-z_]+(?=( = |: |\.))", message)
    return () if found is None or found[0] == "permitted" else (found[0],)


def _member(value: object, step: str | int) -> object:
    if isinstance(value, Mapping):
        return value.get(step)
    if isinstance(value, Sequence) and not isinstance(value, str) and isinstance(step, int) and step < len(value):
        return value[step]
    return None


def _at(place: FieldPath, schema: JsonSchema, given: object) -> JsonSchema:
    """The part of the schema that describes a field."""
    node = _resolve(schema, schema, given)
    for step in place:
        given = _member(given, step)
        inner = node.get("properties", {}).get(step) or node.get("items") or node.get("additionalProperties") or {}
        node = _resolve(inner if isinstance(inner, Mapping) else {}, schema, given)
    return node


def _resolve(node: JsonSchema, schema: JsonSchema, given: object) -> JsonSchema:
    """Follow references, and choose the member of a union that fits the given value."""
    if "$ref" in node:
        return _resolve(schema["$defs"][node["$ref"].rsplit("/", 1)[-1]], schema, given)
    mapping = node.get("discriminator", {}).get("mapping", {})
    if isinstance(given, Mapping) and given.get("kind") in mapping:
        return _resolve({"$ref": mapping[given["kind"]]}, schema, given)
    members = [_resolve(member, schema, given) for member in node.get("anyOf", ()) if member.get("type") != "null"]
    if len(members) == 1:
        return {**members[0], "or_null": True}
    if isinstance(given, Mapping):
        return next((member for member in members if member.get("type") == "object"), node)
    return node


def _fields(node: JsonSchema) -> list[str]:
    return list(node.get("properties", {}))


def _permitted(place: FieldPath, schema: JsonSchema, given: object) -> str:
    node = _at(place, schema, given)
    text = _words(node, schema)
    return f"{text}, or null" if node.get("or_null") else text


def _words(node: JsonSchema, schema: JsonSchema) -> str:
    """Describe in words what a schema permits."""
    if "discriminator" in node:
        return f"kind {', '.join(node['discriminator']['mapping'])}"
    if "anyOf" in node:
        return " or ".join(_words(_resolve(member, schema, None), schema) for member in node["anyOf"])
    if "enum" in node or "const" in node:
        return ", ".join(map(str, node.get("enum", [node.get("const")])))
    kind = node.get("type")
    if kind == "null":
        return "null"
    if kind in ("number", "integer"):
        return f"a {'whole ' if kind == 'integer' else ''}number{_range(node)}"
    if kind == "array":
        top = f" to {node['maxItems']}" if "maxItems" in node else " or more"
        return f"a list of {node.get('minItems', 0)}{top}"
    if kind == "object":
        fields = _fields(node)
        return f"the fields {', '.join(fields)}" if fields else "pairs of a name and a number"
    if node.get("pattern", PRINTABLE) != PRINTABLE:
        return f"text like {_EXAMPLES.get(node['pattern'], node['pattern'])}"
    return f"text of at most {node['maxLength']} characters" if "maxLength" in node else "text"


_EXAMPLES = {
    r"^([01]\d|2[0-3]):[0-5]\d$": "11:00",
    r"^(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])$": "04-15, a month and a day",
    r"^[a-z0-9][a-z0-9_-]{0,62}$": "p1: 1 to 63 of a-z, 0-9, _ and -, beginning with a letter or digit",
    r"^[a-z][a-z0-9_-]{0,15}$": "h: 1 to 16 of a-z, 0-9, _ and -, beginning with a letter",
    r"^[0-9a-f]{64}$": "64 hexadecimal digits",
}


def _range(node: JsonSchema) -> str:
    low, high = node.get("minimum"), node.get("maximum")
    above, below = node.get("exclusiveMinimum"), node.get("exclusiveMaximum")
    start = f" from {low:g}" if low is not None else f" above {above:g}" if above is not None else ""
    if high is not None:
        return f"{start} to {high:g}"
    return f"{start} to below {below:g}" if below is not None else f"{start} up" if low is not None else start
