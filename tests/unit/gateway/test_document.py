"""The OpenAPI document: every answer with an example that fits its schema, every error as a problem."""

from __future__ import annotations

from typing import Any

import jsonschema
import pytest

from zengrid_gateway.access import Access
from zengrid_gateway.app import create_app
from zengrid_gateway.settings import Settings
from zengrid_gateway.tokens import Tokens

METHODS = ("get", "post", "delete")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return create_app(Settings(), Access("nothing", Tokens({}))).openapi()


def operations(document: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [
        (f"{method} {path}", operation)
        for path, item in document["paths"].items()
        for method, operation in item.items()
        if method in METHODS
    ]


def test_every_route_says_what_it_does(document: dict[str, Any]) -> None:
    assert len(operations(document)) >= 18
    for name, operation in operations(document):
        assert operation["description"], name
        for parameter in operation.get("parameters", []):
            assert "description" in parameter or parameter["in"] == "path", f"{name}: {parameter['name']}"


def test_every_answer_has_an_example_that_fits(document: dict[str, Any]) -> None:
    for name, operation in operations(document):
        for status, response in operation["responses"].items():
            for media_type, media in response.get("content", {}).items():
                examples = (
                    [media["example"]]
                    if "example" in media
                    else [e["value"] for e in media.get("examples", {}).values()]
                )
                if media_type in ("text/csv", "application/vnd.apache.parquet"):
                    continue
                assert examples, f"{name} {status} {media_type}"
                for example in examples:
                    if "json" in media_type:
                        jsonschema.validate(example, {**media["schema"], "components": document["components"]})


def test_every_error_is_a_problem(document: dict[str, Any]) -> None:
    for name, operation in operations(document):
        assert {"401", "429", "500"} <= set(operation["responses"]), name
        for status, response in operation["responses"].items():
            if int(status) >= 400:
                assert list(response["content"]) == ["application/problem+json"], f"{name} {status}"


def test_examples_of_bodies_fit(document: dict[str, Any]) -> None:
    for name, operation in operations(document):
        if "requestBody" in operation:
            schema = operation["requestBody"]["content"]["application/json"]["schema"]
            reference = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
            assert reference["examples"], name
            for example in reference["examples"]:
                jsonschema.validate(example, {**schema, "components": document["components"]})
