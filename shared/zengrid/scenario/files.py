"""Reads and writes scenarios as YAML; built-in scenarios are loaded by name."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from zengrid.errors import ScenarioError
from zengrid.scenario.explain import explain
from zengrid.scenario.scenario import Scenario
from zengrid.scenario.source import BuiltinData, content_hash
from zengrid.validation import FieldPath

try:
    from yaml import CSafeDumper as SafeDumper
    from yaml import CSafeLoader as SafeLoader
except ImportError:  # built without the C library
    from yaml import SafeDumper, SafeLoader  # type: ignore[assignment]

_BUILTIN = Path(__file__).parent / "builtin"
_POWER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$")


class _Loader(SafeLoader):
    """Reads ``1e3`` as a number, as YAML 1.2 and everybody else does."""


class _Dumper(SafeDumper):
    """Puts a text like ``1e3`` in quotes."""


for _kind in (_Loader, _Dumper):
    _kind.add_implicit_resolver("tag:yaml.org,2002:float", _POWER, list("-+.0123456789"))

MOST_DEPTH = 50
"""Deepest nesting of a file; scenarios need six levels."""

BUILTIN = ("paper", "fontana", "village", "city")
"""Scenarios that ship with zengrid."""


def load(name_or_path: str | Path, *, data: Path | None = None, seed: int | None = None) -> Scenario:
    """Load a built-in scenario or a file.

    Parameters
    ----------
    name_or_path:
        ``paper``, ``fontana``, ``village``, ``city``, or the path of a YAML file.
    data:
        Path of the measured data, for scenarios that use it (``data.path``).
    seed:
        Replaces the scenario's own seed.

    Raises
    ------
    ScenarioError
        There is no such scenario, or it is invalid: one line for each field, with its value and permitted values.
    """
    path = _BUILTIN / f"{name_or_path}.yaml" if str(name_or_path) in BUILTIN else Path(name_or_path).expanduser()
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        there = f"permitted: {', '.join(BUILTIN)}, or the path of a YAML file"
        raise ScenarioError(f"scenario {str(name_or_path)!r}: cannot be read ({error.strerror}); {there}") from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: is not a YAML file in UTF-8 ({error})") from None
    scenario = loads(text, where=str(path), folder=path.parent, data=data, seed=seed)
    scenario.data.files(scenario.slot_minutes)  # If data is missing, raise the error that says where to get it.
    return scenario


def loads(
    text: str, *, where: str = "scenario", folder: Path | None = None, data: Path | None = None, seed: int | None = None
) -> Scenario:
    """Read a scenario from YAML text, such as ``dumps`` writes.

    Parameters
    ----------
    text:
        The YAML.
    where:
        Name of the text in error messages.
    folder:
        Folder of relative data paths; by default the current folder.
    data, seed:
        As in ``load``.

    Raises
    ------
    ScenarioError
        As ``load`` does.
    """
    fields, node = _parsed(text, where)
    if data is not None:
        source = fields.get("data")
        if not isinstance(source, dict) or source.get("kind") not in ("citylearn", "csv"):
            raise ScenarioError(f"{where}: uses no measured data from a single path; given: {data}")
        source["path"] = str(Path(data).expanduser().resolve())
    if seed is not None:
        fields["seed"] = seed
    try:
        return Scenario.model_validate(fields, context={"folder": folder or Path.cwd()})
    except ValidationError as error:
        found = explain(error, fields, Scenario.model_json_schema(by_alias=True), _lines(node)).splitlines()
        raise ScenarioError("\n".join(f"{where}, {line}" for line in found)) from None


def parse(text: str) -> dict[str, Any]:
    """Return the fields of a scenario as text, without checking them.

    Raises
    ------
    ScenarioError
        The text is not YAML.
    """
    return _parsed(text, "scenario")[0]


def _parsed(text: str, where: str) -> tuple[dict[str, Any], yaml.Node | None]:
    loader = _Loader(text)
    try:
        _refuse_depth(text, where)
        node = loader.get_single_node()
        _refuse_doubles(node, where)
        fields = loader.construct_document(node) if node is not None else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark is not None else ""
        raise ScenarioError(f"{where}{line}: is not YAML ({getattr(error, 'problem', error)})") from None
    finally:
        loader.dispose()
    if not isinstance(fields, dict):
        raise ScenarioError(f"{where}: holds no fields; needed: name, tariff, facilities, homes and the like")
    return fields, node


def dumps(scenario: Scenario) -> str:
    """Write the complete scenario as YAML text, with all defaults, the absolute paths of data files and their hash."""
    fields = scenario.model_dump(mode="json", by_alias=True, exclude=scenario.drawn)
    if not isinstance(scenario.data, BuiltinData):
        fields["data"]["sha256"] = content_hash(scenario.data.files(scenario.slot_minutes))
    return write(fields)


def write(fields: dict[str, Any]) -> str:
    """Fields as YAML; the inverse of ``parse``."""
    text: str = yaml.dump(fields, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)
    return text


def _refuse_depth(text: str, where: str) -> None:
    """The parser builds what is nested by calling itself, and some ten thousand levels would end the process."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MOST_DEPTH:
                line = "" if event.start_mark is None else f", line {event.start_mark.line + 1}"
                raise ScenarioError(f"{where}{line}: nested deeper than {MOST_DEPTH} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _refuse_doubles(root: yaml.Node | None, where: str) -> None:
    """Raise ScenarioError for two fields of one name: YAML would silently use the last one."""
    waiting, known = [root], set()
    while waiting:
        node = waiting.pop()
        if id(node) in known:  # An alias may refer to a node that contains it.
            continue
        known.add(id(node))
        if isinstance(node, yaml.MappingNode):
            names: set[str] = set()
            for key, value in node.value:
                if key.value in names:
                    line = key.start_mark.line + 1
                    raise ScenarioError(f"{where}, line {line}: {key.value} appears twice; permitted: once")
                names.add(key.value)
                waiting.append(value)
        elif isinstance(node, yaml.SequenceNode):
            waiting.extend(node.value)


def _lines(root: yaml.Node | None) -> Callable[[FieldPath], int | None]:
    def line_of(place: FieldPath) -> int | None:
        node: Any = root
        line = None
        for step in place:
            if isinstance(node, yaml.MappingNode):
                found = next(((key, value) for key, value in node.value if key.value == str(step)), None)
                if found is None:
                    break
                line, node = found[0].start_mark.line + 1, found[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                node = node.value[step]
                line = node.start_mark.line + 1
            else:
                break
        return line

    return line_of
