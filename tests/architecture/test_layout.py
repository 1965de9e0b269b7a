"""How sources lie: no two modules import each other in a circle."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ("antinode", "geometry", "solvers", "pipeline", "studies", "firmware")


def sources(root: Path) -> Iterator[Path]:
    for folder in SOURCES:
        yield from (root / folder).rglob("*.py")


def imports(root: Path) -> dict[str, set[str]]:
    """Module -> modules that it imports anywhere: at its top, inside functions, for types alone."""
    names = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in sources(root)
    }
    return {name: set(_imported(path, names.keys())) - {name} for name, path in names.items()}


def _imported(path: Path, known: object) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield from (name for name in (full if full in known else node.module,) if name in known)


def circle(graph: dict[str, set[str]]) -> list[str]:
    """One circle of modules, the first named again at the end; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as result:
        return list(result.args[1])
    return []


def planted(root: Path, **texts: str) -> Path:
    for name, text in texts.items():
        (root / "geometry").mkdir(exist_ok=True)
        (root / "geometry" / f"{name}.py").write_text(text)
    return root


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = imports(ROOT)
    assert len(graph) > 200
    assert "geometry.elements" in graph["geometry.mesh"]  # the search itself works
    assert not circle(graph), " -> ".join(circle(graph))


@pytest.mark.parametrize(
    "back",
    [
        "import geometry.one\n",
        "def late():\n    from geometry import one\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from geometry.one import Some\n",
    ],
    ids=["plain", "late", "for types alone"],
)
def test_a_circle_is_seen(back: str, tmp_path: Path) -> None:
    root = planted(tmp_path, one="from geometry import two\n", two="from geometry.three import x\n", three=back)
    assert sorted(set(circle(imports(root)))) == ["geometry.one", "geometry.three", "geometry.two"]
