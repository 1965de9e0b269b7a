"""What the documentation site says of the commands' JSON documents, held against documents."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

FIELDS = Path(__file__).resolve().parents[2] / "docs" / "site" / "fields.toml"
EVERY = {"schema", "case", "with_defaults", "version", "seconds", "kind", "options", "warnings"}


@cache
def documents() -> dict[str, dict[str, str]]:
    """Meanings of the fields that a command's document has beside, or in place of, a part of records."""
    fields: dict[str, dict[str, str]] = tomllib.loads(FIELDS.read_text(encoding="utf-8"))["documents"]
    return fields


def differing(command: str, document: dict[str, Any]) -> list[str]:
    """Fields of a document that its page has not, or the other way round, and names within one that its text has not.

    Names with a space are of things, as `pair at 3000 Hz`.
    """
    fields = (documents()["active"] if command.startswith("active ") else {}) | documents()[command]
    inner = [f"{key}.{name}" for key in fields.keys() & document.keys() for name in _names(document[key])
             if " " not in name and not re.search(rf"\b{re.escape(name)}\b", fields[key])]  # fmt: skip
    return sorted((document.keys() ^ fields.keys()) - EVERY) + sorted(inner)


def _names(value: Any) -> set[str]:
    """Every key within a value."""
    within = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return set(value if isinstance(value, dict) else ()).union(*map(_names, within))
