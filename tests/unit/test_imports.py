"""No module imports itself through others, counting the imports inside functions and those for type hints alone."""

from __future__ import annotations

import ast
from collections.abc import Container, Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ("shared", "services")

STILL_OPEN = {frozenset({"zengrid.learn.sweep.sweep", "zengrid.learn.sweep.table"})}
"""Circles that are still to be cut. The list may only become shorter."""

Graph = dict[str, set[str]]


def test_no_module_imports_itself_through_others() -> None:
    found = circles(module_graph(ROOT / source for source in SOURCES))
    new = [" <-> ".join(sorted(circle)) for circle in found - STILL_OPEN]
    assert not new, f"modules that import each other: {'; '.join(new)}"
    cut = [" <-> ".join(sorted(circle)) for circle in STILL_OPEN - found]
    assert not cut, f"no longer a circle, so remove it from STILL_OPEN: {'; '.join(cut)}"


def test_a_circle_is_found_wherever_its_imports_stand(tmp_path: Path) -> None:
    package = tmp_path / "house"
    package.mkdir()
    files = {
        "__init__": "from house.roof import slope",
        "roof": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.wall import height\n",
        "wall": "def height():\n    import house.floor\n",
        "floor": "from house import roof\nimport house.door as door\n",
        "door": "import os\n",
    }
    for name, text in files.items():
        (package / f"{name}.py").write_text(text, encoding="utf-8")
    graph = module_graph([tmp_path])
    assert graph["house.floor"] == {"house.roof", "house.door"}
    assert circles(graph) == {frozenset({"house.roof", "house.wall", "house.floor"})}


def module_graph(folders: Iterable[Path]) -> Graph:
    """The modules that each module of some source folders imports; modules outside of them are left out."""
    files = {name(path, folder): path for folder in folders for path in folder.rglob("*.py")}
    graph = {
        module: set(imported(ast.parse(path.read_text(encoding="utf-8")), files.keys())) - {module}
        for module, path in files.items()
    }
    assert graph, "no Python file found"
    return graph


def name(path: Path, folder: Path) -> str:
    """Dotted name of the module in a file."""
    parts = path.relative_to(folder).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(tree: ast.Module, modules: Container[str]) -> Iterator[str]:
    """Names of those modules that a file imports anywhere."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: import {node.module} by its full name"
            for alias in node.names:
                member = f"{node.module}.{alias.name}"
                if member in modules:
                    yield member
                elif node.module and node.module in modules:
                    yield node.module


def circles(graph: Graph) -> set[frozenset[str]]:
    """Sets of modules of which each reaches all others (Tarjan, doi:10.1137/0201010), without those of one module."""
    found: set[frozenset[str]] = set()
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    path: list[str] = []

    def visit(module: str) -> None:
        order[module] = lowest[module] = len(order)
        path.append(module)
        for other in sorted(graph[module]):
            if other not in order:
                visit(other)
                lowest[module] = min(lowest[module], lowest[other])
            elif other in path:
                lowest[module] = min(lowest[module], order[other])
        if lowest[module] == order[module]:
            start = path.index(module)
            members = frozenset(path[start:])
            del path[start:]
            if len(members) > 1:
                found.add(members)

    for module in sorted(graph):
        if module not in order:
            visit(module)
    return found
