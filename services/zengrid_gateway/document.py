"""The OpenAPI document: FastAPI's, completed by the problem's schema and an example of every answer."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from zengrid_gateway.problems import ProblemDetails

DESCRIPTION = """\
A live market of prosumers over HTTP: prices, state, history, policies, and new homes.

Slots and days count from 0; powers are in kW (> 0 is generated, exported or charged), energies in kWh, money in
dollars. "Conventional" is the same market on the same days without demand response. Every error is a
[problem](https://www.rfc-editor.org/rfc/rfc9457) whose detail names the thing, its value and what is allowed.
"""

Schema = dict[str, Any]


def describe(app: FastAPI) -> Schema:
    """The document of an application."""
    document = get_openapi(
        title=app.title, version=app.version, description=DESCRIPTION, routes=app.routes, openapi_version="3.1.0"
    )
    schemas: Schema = document["components"]["schemas"]
    problem = ProblemDetails.model_json_schema(ref_template="#/components/schemas/{model}")
    schemas |= {**problem.pop("$defs"), "Problem": problem}
    for path in document["paths"].values():
        for operation in path.values():
            _add_examples(operation, schemas)
            if "security" in operation:
                operation["security"].append({})  # a gateway on loopback asks for no token
    return document


def _add_examples(operation: Schema, schemas: Schema) -> None:
    for response in operation["responses"].values():
        media = response.get("content", {}).get("application/json")
        if media is not None and "example" not in media:
            media["example"] = example(media["schema"], schemas)


def example(schema: Schema, schemas: Schema) -> Any:
    """A value that fits a schema, made of the examples of its parts."""
    if "$ref" in schema:
        return example(schemas[schema["$ref"].rpartition("/")[2]], schemas)
    if "examples" in schema:
        return schema["examples"][0]
    for name in ("const", "default"):
        if schema.get(name) is not None:
            return schema[name]
    if "enum" in schema:
        return schema["enum"][0]
    if "anyOf" in schema:
        return example(schema["anyOf"][0], schemas)
    match schema.get("type"):
        case "object" if "properties" in schema:
            return {name: example(part, schemas) for name, part in schema["properties"].items()}
        case "object":
            return {"p1": example(schema["additionalProperties"], schemas)} if "additionalProperties" in schema else {}
        case "array":
            return [example(schema["items"], schemas)] if "items" in schema else []
        case "string":
            return _text(schema)
        case "integer":
            return int(max(schema.get("minimum", 0), 0))
        case "number":
            return 1.0
        case "boolean":
            return False
    return None


def _text(schema: Schema) -> str:
    if schema.get("format") == "date-time":
        return "2026-04-15T12:00:00Z"
    return "p1" if "pattern" in schema else ""
