"""No module imports itself through others as it loads: which one is asked for first must not matter."""

from __future__ import annotations

import ast
import graphlib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("antinode", "geometry", "solvers", "pipeline", "studies", "firmware")
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*.py")
}


def loaded(body: list[ast.stmt]) -> Iterator[ast.Import | ast.ImportFrom]:
    """The imports that run as a module loads: those in functions and for type checkers do not."""
    for node in body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.Try | ast.ClassDef):
            yield from loaded(node.body)
        elif isinstance(node, ast.If) and ast.unparse(node.test) != "TYPE_CHECKING":
            yield from loaded([*node.body, *node.orelse])


def asked_for(source: str, modules: set[str]) -> set[str]:
    """The modules among some that a source imports as it loads."""
    found = set()
    for node in loaded(ast.parse(source).body):
        names = [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            names = [
                f"{node.module}.{name}" if f"{node.module}.{name}" in modules else str(node.module) for name in names
            ]
        found |= modules.intersection(names)
    return found


def ordered(sources: dict[str, str]) -> list[str]:
    """Modules in an order in which each can load; CycleError where there is none."""
    return [
        *graphlib.TopologicalSorter(
            {name: asked_for(text, {*sources}) for name, text in sources.items()}
        ).static_order()
    ]


def test_modules_load_in_some_order() -> None:
    assert len(ordered({name: path.read_text() for name, path in MODULES.items()})) == len(MODULES)


def test_a_circle_is_found_and_a_late_import_is_none() -> None:
    assert ordered({"a": "import b", "b": "def f():\n    import a"}) == ["b", "a"]
    with pytest.raises(graphlib.CycleError):
        ordered({"a": "from p import b", "p.b": "import c", "c": "from a import x", "p": ""})
