"""Checks of the documentation of the commands' JSON documents against real documents."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.questions import registered
from pipeline.records.part import Part, part_of

FIELDS = Path(__file__).resolve().parents[2] / "docs" / "site" / "fields.toml"
EVERY = {"schema", "case", "with_defaults", "version", "seconds", "kind", "options", "warnings"}


@cache
def documents() -> dict[str, dict[str, str]]:
    """Meanings of the fields that a command's document has in addition to, or instead of, a part of records."""
    fields: dict[str, dict[str, str]] = tomllib.loads(FIELDS.read_text(encoding="utf-8"))["documents"]
    return fields


def differing(command: str, document: dict[str, Any]) -> list[str]:
    """Fields missing from a document's page or from the document, and names within a field missing from its text.

    Names with a space are of things, as `pair at 3000 Hz`.
    """
    question = registered().get(command)
    fields = {name: each.about for name, each in question.result.declared.items()} if question else documents()[command]
    said = {key for key in fields if question and _is_declared(question.result, key)}
    inner = [f"{key}.{name}" for key in (fields.keys() - said) & document.keys() for name in _names(document[key])
             if " " not in name and not re.search(rf"\b{re.escape(name)}\b", fields[key])]  # fmt: skip
    return sorted((document.keys() ^ fields.keys()) - EVERY) + sorted(inner)


def _is_declared(kind: type[Part], name: str) -> bool:
    """Whether a field holds parts, which describe their own fields."""
    held = part_of(kind, name)
    return isinstance(held, type) and issubclass(held, Part)


def _names(value: Any) -> set[str]:
    """Every key within a value."""
    within = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return set(value if isinstance(value, dict) else ()).union(*map(_names, within))
