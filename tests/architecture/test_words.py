"""Plain English: no phrase of a list in names, messages, comments, docstrings, docs and pages.

Comments and strings of Python, comments of JavaScript and C, other files whole. Left out: tests, and the page on former names.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import tokenize
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
KINDS = re.compile(r"(\.(md|toml|py|j2|html|ipynb|js|c|h)|Makefile)$")
KEY = re.compile(r"[\"']\w+[\"']")  # a field of data, not a phrase
LEFT_OUT = re.compile(r"^(tests|results)/|vendor|^docs/reference/schema\.md$|^docs/licences\.md$")
LISTED = tomllib.loads((Path(__file__).parent / "words.toml").read_text(encoding="utf-8"))
PHRASES = {write: re.compile(phrase, re.MULTILINE) for write, phrase in LISTED["phrases"].items()}
NAMES = {re.compile(name): write for name, write in LISTED["names"].items()}
ANY_NAME = re.compile(rf"\b(?:{'|'.join(LISTED['names'])})\b")


def prose(name: str, text: str) -> Iterator[tuple[int, str]]:
    """Comments and strings of a source, else the whole text, each with the line that it begins in."""
    if name.endswith(".py"):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type in (tokenize.COMMENT, tokenize.STRING) and not KEY.fullmatch(token.string):
                yield token.start[0], token.string
    elif name.endswith((".js", ".c", ".h")):
        for found in re.finditer(r"//[^\n]*|/\*.*?\*/", text, re.DOTALL):
            yield text.count("\n", 0, found.start()) + 1, found.group()
    else:
        yield 1, text


def hits(name: str, text: str) -> Iterator[str]:
    """Each phrase of the list that a file holds: its place, itself, and what to write."""
    for line, part in prose(name, text):
        for write, phrase in PHRASES.items():
            for found in phrase.finditer(part):
                yield f"{name}:{line + part.count(chr(10), 0, found.start())}: {found.group()!r}, write: {write}"


def banned(text: str) -> list[str]:
    """Names on the list that a Python source defines or uses; most have none anywhere, and need not be parsed."""
    if not ANY_NAME.search(text):
        return []
    tree = ast.walk(ast.parse(text))
    names = (getattr(node, "id", None) or getattr(node, "attr", None) or getattr(node, "name", None) for node in tree)
    return [name for name in names if isinstance(name, str) and any(each.fullmatch(name) for each in NAMES)]


def tracked() -> list[str]:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split(
        "\n"
    )
    return [name for name in listed if KINDS.search(name) and not LEFT_OUT.search(name) and (ROOT / name).is_file()]


def test_no_file_holds_a_phrase_of_the_list() -> None:
    found = [hit for name in tracked() for hit in hits(name, (ROOT / name).read_text(encoding="utf-8"))]
    assert not found, "\n".join(found)


def test_no_source_has_a_name_of_the_list() -> None:
    found = {name: banned((ROOT / name).read_text(encoding="utf-8")) for name in tracked() if name.endswith(".py")}
    assert not {name: names for name, names in found.items() if names}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.md", "The wanted mode."),
        ("a.py", '"""How far the mesh puts it off."""'),
        ("a.py", "# an endless lattice"),
        ("a.c", "int x; /* three rows a pillar */"),
        ("a.js", "const x = 1; // half a wave"),
        ("a.toml", 'text = "errors by the mesh"'),
    ],
)
def test_a_phrase_that_is_put_back_is_found(name: str, text: str) -> None:
    assert list(hits(name, text))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.md", "Pillars stand beside the zone."),
        ("a.py", "beside = 1"),
        ("a.c", "int told;"),
        ("a.md", "to tell two modes apart"),
    ],
)
def test_plain_words_are_left_alone(name: str, text: str) -> None:
    assert not list(hits(name, text))


def test_a_name_that_is_put_back_is_found() -> None:
    assert banned("class Beneath: pass\nwanted_hz = 1.0") == ["Beneath", "wanted_hz"]
