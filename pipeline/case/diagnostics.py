"""Turning what is wrong with a file into one line each: file, key, what came, what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from contextlib import suppress
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from pipeline.errors import InputError

Checked = TypeVar("Checked", bound=BaseModel)
MAX_LENGTH = 60  # characters of a value or key that are shown
MAX_NAMES = 2000  # of a folder that a misspelled name is compared with
MAX_LINES = 50  # faults told one by one; a file with more is no case file


def quoted(value: Any) -> str:
    """A value as TOML would write it, cut to one short line."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = '"' + value[:MAX_LENGTH].encode("unicode_escape").decode().replace('"', '\\"') + '"'
        text = text if len(value) <= MAX_LENGTH else text[:-1].ljust(MAX_LENGTH + 1, ".")
    elif isinstance(value, dict):
        first = islice(value.items(), MAX_LENGTH)
        text = "{" + ", ".join(f"{key_quoted(key)} = {quoted(item)}" for key, item in first) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(quoted(item) for item in value[:MAX_LENGTH]) + "]"
    elif isinstance(value, float):
        text = f"{value:.12g}"
    else:
        text = str(value) if not isinstance(value, int) or abs(value) < 10**30 else "an integer beyond 1e30"
    return text if len(text) <= MAX_LENGTH else text[: MAX_LENGTH - 3] + "..."


def key_quoted(key: str) -> str:
    """A key as it stands in a file, cut to one short line."""
    return key if len(key) <= MAX_LENGTH else f"{key[: MAX_LENGTH - 3]}..."


def nearest(word: str, known: Collection[str]) -> str:
    """' (did you mean X?)' with the known word nearest to `word`, or nothing when none resembles it.

    A dotted key is compared whole first, then by its last part; what is longer than any key resembles none.
    """
    if len(word) > MAX_LENGTH:
        return ""
    match = get_close_matches(word, known, n=1, cutoff=0.6)
    if not match:
        leaves: dict[str, str] = {}
        for name in known:
            leaves.setdefault(name.rpartition(".")[2], name)
        match = [leaves[leaf] for leaf in get_close_matches(word.rpartition(".")[2], leaves, n=1, cutoff=0.6)]
    return f" (did you mean {match[0]}?)" if match else ""


def nearest_file(path: Path) -> str:
    """' (did you mean X?)' with the file that is there under nearly this name, folder by folder, or nothing."""
    there = Path(path.anchor)
    with suppress(OSError, ValueError):
        for part in path.relative_to(path.anchor).parts:
            if not (there / part).exists():
                names = sorted(each.name for each in islice(there.iterdir(), MAX_NAMES))
                match = get_close_matches(part, names, n=1, cutoff=0.75)
                if not match:
                    return ""
                part = match[0]
            there /= part
        return f" (did you mean {there}?)" if there.is_file() else ""
    return ""


class Diagnostics:
    """The lines found so far in one file; overridden keys are told as coming from --set."""

    def __init__(self, file: str, overridden: Iterable[str] = ()) -> None:
        self.file = file
        self.overridden = frozenset(overridden)
        self.lines: list[str] = []
        self.keys: set[str] = set()
        self.untold = 0

    def origin(self, key: str) -> str:
        """The file's name, or --set when the key or a part of it was set on the command line."""
        from_command = any(key == name or name.startswith(key + ".") for name in self.overridden)
        return "--set" if from_command else self.file

    def add(self, key: str, value: Any, text: str) -> None:
        """One line: origin: key = value: text."""
        self._note(key, f"{self.origin(key)}: {key_quoted(key)} = {quoted(value)}: {text}")

    def missing(self, key: str, text: str) -> None:
        """One line for a key that is not there."""
        self._note(key, f"{self.file}: {key}: missing, {text}")

    def touch(self, *tables: str) -> bool:
        """True when a fault was found in one of these tables or top keys."""
        return any(key.partition(".")[0] in tables for key in self.keys)

    def _note(self, key: str, line: str) -> None:
        self.keys.add(key)
        if len(self.lines) >= MAX_LINES:
            self.untold += 1
        elif line not in self.lines:
            self.lines.append(line)

    def unknown(self, key: str, value: Any, known: Collection[str]) -> None:
        """One line for a key that does not exist, with the nearest known one."""
        hint = nearest(key, known) if len(self.lines) < MAX_LINES else ""
        self.add(key, value, f"unknown {'table' if isinstance(value, dict) else 'key'}{hint}")

    def stop(self) -> None:
        """InputError with every line, if there is any; beyond MAX_LINES of them with how many there are."""
        if self.lines:
            more = [f"{self.file}: {self.untold} more errors"] if self.untold else []
            raise InputError([*self.lines, *more])


def _allowed(field: FieldInfo) -> str:
    """What a field may be: its description, or the words of its type."""
    *first, last = [str(word) for word in get_args(field.annotation)] or ["something else"]
    return field.description or (f"{', '.join(first)} or {last}" if first else last)


def check_table(
    model: type[Checked], raw: dict[str, Any], prefix: str, known: Collection[str], diagnostics: Diagnostics
) -> tuple[Checked, set[str]]:
    """A table with its valid values, defaults filled in, and its faulty keys, dotted with prefix, which are None in it.

    Every fault is added to `diagnostics`.
    """
    bad: dict[str, str] = {}
    try:
        model.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            bad.setdefault(str(detail["loc"][0]), detail["type"])
    fields = model.model_fields
    for name, kind in bad.items():
        key, value = prefix + name, raw.get(name)
        allowed = _allowed(fields[name]) if name in fields else ""
        if kind == "extra_forbidden":
            diagnostics.unknown(key, value, known)
        elif kind == "missing":
            diagnostics.missing(key, f"must be {allowed}")
        else:
            named = kind == "literal_error" and isinstance(value, str)
            hint = nearest(str(value), allowed.replace(" or ", ", ").split(", ")) if named else ""
            diagnostics.add(key, value, f"must be {allowed}{hint}")
    valid = {
        name: raw[name] if name in raw else field.get_default(call_default_factory=True)
        for name, field in fields.items()
        if name not in bad
    }
    return model.model_construct(**dict.fromkeys(fields) | valid), {prefix + name for name in bad}
