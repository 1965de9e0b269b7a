"""A constant of a module has one value: a second one of its name would take the place of the first in silence."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

from pipeline.paths import ROOT

FOLDERS = ("antinode", "firmware", "geometry", "pipeline", "solvers", "studies")
MODULES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))


def repeated(source: str) -> list[str]:
    """Names in capitals that a module assigns more than once at its top."""
    names: Counter[str] = Counter()
    for each in ast.parse(source).body:
        targets = (
            each.targets if isinstance(each, ast.Assign) else [each.target] if isinstance(each, ast.AnnAssign) else []
        )
        for target in targets:
            names.update(node.id for node in ast.walk(target) if isinstance(node, ast.Name) and node.id.isupper())
    return [name for name, count in names.items() if count > 1]


def test_a_second_value_is_seen() -> None:
    assert repeated("A, B = 1, 2\nC: int = 3\nB = 4\nlow = 1\nlow = 2") == ["B"]


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_constant_has_two_values(folder: str) -> None:
    own = [path for path in MODULES if path.is_relative_to(ROOT / folder)]
    found = {str(path.relative_to(ROOT)): names for path in own if (names := repeated(Path(path).read_text("utf-8")))}
    assert own and not found
