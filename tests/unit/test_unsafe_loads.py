"""No file or message can make zengrid run code: nothing in the code base unpickles or evaluates what it reads."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    path for folder in ("shared", "services", "benchmarks", "deploy") for path in (ROOT / folder).rglob("*.py")
)

MODULES = {"pickle", "cPickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "jsonpickle"}
"""What reads objects, and so runs what they ask for."""
CALLS = {"eval", "exec", "compile", "__import__", "os.system", "os.popen"}
METHODS = {"read_pickle", "to_pickle", "unsafe_load", "unsafe_load_all", "full_load", "full_load_all", "load_all"}


def name_of(node: ast.expr) -> str:
    """``torch.load`` of ``torch.load``; empty where it is no name."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = name_of(node.value)
        return f"{inner}.{node.attr}" if inner else node.attr
    return ""


def is_constant(call: ast.Call, keyword: str, wanted: object) -> bool:
    given = [each.value for each in call.keywords if each.arg == keyword]
    return len(given) == 1 and isinstance(given[0], ast.Constant) and given[0].value is wanted


def unsafe(source: str) -> Iterator[str]:
    """What in a source could run what it reads."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [each.name for each in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            yield from (f"import {module}" for module in modules if module.split(".")[0] in MODULES)
        elif isinstance(node, ast.Call) and is_unsafe(node, name_of(node.func)):
            yield ast.unparse(node)


def is_unsafe(call: ast.Call, name: str) -> bool:
    given = {each.arg for each in call.keywords}
    if name == "torch.load":
        return not is_constant(call, "weights_only", True)
    if name == "yaml.load":
        return not any("Safe" in ast.dump(it) for it in (*call.args[1:], *call.keywords))
    open_to_objects = "allow_pickle" in given and not is_constant(call, "allow_pickle", False)
    by_a_shell = "shell" in given and not is_constant(call, "shell", False)
    return name in CALLS or name.rpartition(".")[2] in METHODS or open_to_objects or by_a_shell


def test_nothing_that_is_read_can_run() -> None:
    assert len(SOURCES) > 200
    found = {path: list(unsafe(path.read_text(encoding="utf-8"))) for path in SOURCES}
    assert {path: calls for path, calls in found.items() if calls} == {}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle", "from pickle import loads", "import torch; torch.load(path)",
        "torch.load(path, weights_only=False)", "torch.load(path, weights_only=safe)",
        "np.load(path, allow_pickle=True)", "numpy.load(path, allow_pickle=flag)", "yaml.load(text)",
        "yaml.load(text, yaml.Loader)",
        "yaml.load(text, Loader=yaml.FullLoader)", "yaml.unsafe_load(text)", "pd.read_pickle(path)", "eval(text)",
        "exec(text)", "subprocess.run(text, shell=True)", "os.system(text)", "import joblib.numpy_pickle",
    ],
)  # fmt: skip
def test_what_would_be_unsafe_is_found(source: str) -> None:
    assert list(unsafe(source))


@pytest.mark.parametrize(
    "source",
    [
        "torch.load(path, weights_only=True)", "np.load(path)", "np.load(path, allow_pickle=False)", "network.eval()",
        "yaml.safe_load(text)", "yaml.load(text, yaml.SafeLoader)", "yaml.load(text, Loader=yaml.CSafeLoader)",
        "re.compile(pattern)", "subprocess.run(words)",
    ],
)  # fmt: skip
def test_what_is_safe_is_permitted(source: str) -> None:
    assert not list(unsafe(source))
