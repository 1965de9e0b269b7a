"""Every source that a docstring names stands in docs/references.bib."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("antinode", "geometry", "solvers", "pipeline", "studies", "firmware")
YEARED = re.compile(r"\b\d?[a-z]+(?:19|20)\d{2}[a-z]?\b")
NAMED = re.compile(r"\bSources?\b[^:.\n]*:\s*([^.]*)")
KEY = re.compile(r"\b\d?[a-z]+\d{2,4}[a-z]?\b")
ENTRY = re.compile(r"^@\w+\{([^,\s]+),", re.MULTILINE)


def keys_in(text: str) -> set[str]:
    """Keys by their form (name and year), and whatever else stands after `Source:` (ieee176)."""
    return set(YEARED.findall(text)) | {key for part in NAMED.findall(text) for key in KEY.findall(part)}


def docstrings(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield ast.get_docstring(node) or ""


def cited() -> dict[str, set[str]]:
    """Key -> files whose docstrings name it."""
    result: dict[str, set[str]] = {}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*.py"):
            for key in set().union(*map(keys_in, docstrings(path))):
                result.setdefault(key, set()).add(path.relative_to(ROOT).as_posix())
    return result


def entries() -> list[str]:
    return ENTRY.findall((ROOT / "docs" / "references.bib").read_text(encoding="utf-8"))


def test_every_cited_key_is_listed() -> None:
    result = cited()
    assert {"craig1968", "ieee176"} <= result.keys()  # the search itself works
    missing = {key: sorted(files) for key, files in result.items() if key not in entries()}
    assert not missing, f"not in docs/references.bib: {missing}"


def test_no_key_is_listed_twice() -> None:
    assert len(entries()) == len(set(entries()))


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        ("Frequencies. Source: leissa1969.", {"leissa1969"}),
        ("(craig1968, castanier2001)", {"craig1968", "castanier2001"}),
        ("Source: ieee176.", {"ieee176"}),
        ("Source of the idea: 3mf2018.", {"3mf2018"}),
        ("RAM at 0x20000000, in 2018", set()),
    ],
)
def test_keys_are_recognised(text: str, keys: set[str]) -> None:
    assert keys_in(text) == keys
