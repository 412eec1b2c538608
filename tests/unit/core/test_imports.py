"""The core stands on numpy alone, also for what is imported inside functions or by others."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

import zengrid.core

FILES = sorted(Path(zengrid.core.__path__[0]).glob("*.py"))
# Reference solutions need a mixed-integer solver, and load it when one is asked for.
PERMITTED = {"numpy", "zengrid"} | set(sys.stdlib_module_names)
INSIDE_FUNCTIONS = {"milp": {"scipy"}}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_core_imports_numpy_alone(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    at_import = {name for node in tree.body for name in imported(node)}
    anywhere = {name for node in ast.walk(tree) for name in imported(node)}
    assert at_import <= PERMITTED
    assert anywhere <= PERMITTED | INSIDE_FUNCTIONS.get(path.stem, set())


def imported(node: ast.AST) -> set[str]:
    """Top-level packages that a statement imports."""
    if isinstance(node, ast.Import):
        return {alias.name.partition(".")[0] for alias in node.names}
    if isinstance(node, ast.ImportFrom):
        return {(node.module or "").partition(".")[0]}
    return set()
