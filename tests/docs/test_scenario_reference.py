"""docs/scenarios.md names every field of a scenario file, with what is permitted and its default."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from zengrid.scenario import BUILTIN, Scenario, loads
from zengrid.scenario.explain import _words

PAGE = Path(__file__).parents[2] / "docs" / "scenarios.md"
SCHEMA = Scenario.model_json_schema(by_alias=True)


def rows() -> Iterator[str]:
    for model in (SCHEMA, *SCHEMA["$defs"].values()):
        for name, field in model.get("properties", {}).items():
            yield row(name, field, name in model.get("required", ()))


def row(name: str, field: dict[str, Any], required: bool) -> str:
    words = _words(field, SCHEMA)
    default = field.get("default")
    if "$ref" in field or "discriminator" in field or " the fields " in f" {words}":
        words, default = "see below", None if default is None and "anyOf" in field else {}
    shown = (
        "" if required else "none" if default in (None, [], "") else "see below" if default == {} else f"`{default}`"
    )
    return f"| `{name}` | {words} | {shown} | {field.get('description', '')} |"


@pytest.mark.parametrize("line", sorted(set(rows())))
def test_every_field_is_documented(line: str) -> None:
    assert line in PAGE.read_text(encoding="utf-8")


def test_every_built_in_scenario_is_documented() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert [name for name in BUILTIN if f"### `{name}`" not in text] == []


def test_examples_are_scenarios(tmp_path: Path) -> None:
    """Every YAML block that begins with a name is a whole scenario."""
    blocks = re.findall(r"^```yaml\n(name: .*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        assert loads(block, folder=tmp_path).homes


def test_python_examples_run() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), {})
