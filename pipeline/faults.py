"""Turning what is wrong with a file into one line each: file, key, what came, what is allowed."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError

from pipeline.errors import InputFault

LONGEST = 60
LONGEST_KEY = 100


def shown(value: Any) -> str:
    """A value as TOML would write it, cut to one short line."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = '"' + value.encode("unicode_escape").decode().replace('"', '\\"') + '"'
    elif isinstance(value, dict):
        text = "{" + ", ".join(f"{key} = {shown(item)}" for key, item in value.items()) + "}"
    elif isinstance(value, (list, tuple)):
        text = "[" + ", ".join(shown(item) for item in value) + "]"
    elif isinstance(value, float):
        text = f"{value:.12g}"
    else:
        text = str(value) if not isinstance(value, int) or abs(value) < 10**30 else "an integer beyond 1e30"
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def shown_key(key: str) -> str:
    """A key as written, the middle of one that no line could hold left out."""
    return key if len(key) <= LONGEST_KEY else f"{key[:70]}...{key[-25:]}"


def nearest(word: str, known: Collection[str]) -> str:
    """' (did you mean X?)' with the known word nearest to `word`, or nothing when none resembles it.

    A dotted key is compared whole first, then by its last part. What is far longer than any known word resembles none.
    """
    if len(word) > LONGEST_KEY:
        return ""
    match = get_close_matches(word, known, n=1, cutoff=0.6)
    if not match:
        leaves: dict[str, str] = {}
        for name in known:
            leaves.setdefault(name.rpartition(".")[2], name)
        match = [leaves[leaf] for leaf in get_close_matches(word.rpartition(".")[2], leaves, n=1, cutoff=0.6)]
    return f" (did you mean {match[0]}?)" if match else ""


class Faults:
    """The lines found so far in one file; overridden keys are told as coming from --set."""

    def __init__(self, file: str, overridden: Iterable[str] = ()) -> None:
        self.file = file
        self.overridden = frozenset(overridden)
        self.lines: list[str] = []
        self.keys: set[str] = set()

    def origin(self, key: str) -> str:
        """The file's name, or --set when the key or a part of it was set on the command line."""
        from_command = any(key == name or name.startswith(key + ".") for name in self.overridden)
        return "--set" if from_command else self.file

    def add(self, key: str, value: Any, text: str) -> None:
        """One line: origin: key = value: text."""
        self._note(key, f"{self.origin(key)}: {shown_key(key)} = {shown(value)}: {text}")

    def missing(self, key: str, text: str) -> None:
        """One line for a key that is not there."""
        self._note(key, f"{self.file}: {key}: missing, {text}")

    def touch(self, *tables: str) -> bool:
        """True when a fault was found in one of these tables or top keys."""
        return any(key.partition(".")[0] in tables for key in self.keys)

    def _note(self, key: str, line: str) -> None:
        self.keys.add(key)
        if line not in self.lines:
            self.lines.append(line)

    def unknown(self, key: str, value: Any, known: Collection[str]) -> None:
        """One line for a key that does not exist, with the nearest known one."""
        self.add(key, value, f"unknown {'table' if isinstance(value, dict) else 'key'}{nearest(key, known)}")

    def stop(self) -> None:
        """InputFault with every line, if there is any."""
        if self.lines:
            raise InputFault(self.lines)


def check_table(
    model: type[BaseModel], raw: dict[str, Any], prefix: str, known: Collection[str], faults: Faults
) -> dict[str, Any]:
    """The valid values of one table, defaults filled in, keys dotted with prefix; every fault is added to `faults`."""
    bad: set[str] = set()
    try:
        model.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            name = str(detail["loc"][0])
            if name not in bad:
                _tell(model, name, detail["type"], raw.get(name), prefix, known, faults)
            bad.add(name)
    fields = model.model_fields
    good = {
        name: raw[name] if name in raw else field.get_default(call_default_factory=True)
        for name, field in fields.items()
        if name not in bad
    }
    return {prefix + name: value for name, value in good.items()}


def _tell(
    model: type[BaseModel], name: str, kind: str, value: Any, prefix: str, known: Collection[str], faults: Faults
) -> None:
    key = prefix + name
    if kind == "extra_forbidden":
        faults.unknown(key, value, known)
        return
    allowed = model.model_fields[name].description or "something else"
    if kind == "missing":
        faults.missing(key, f"must be {allowed}")
    elif kind == "literal_error" and isinstance(value, str):
        faults.add(key, value, f"must be {allowed}{nearest(value, allowed.replace(' or ', ', ').split(', '))}")
    else:
        faults.add(key, value, f"must be {allowed}")
