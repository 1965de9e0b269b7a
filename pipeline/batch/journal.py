"""journal.jsonl: what happened to a study, one JSON object a line, only ever appended to."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any

JOURNAL = "journal.jsonl"


class Journal:
    """Appends lines. A line torn by a killed run is closed first, so that it spoils no other."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / JOURNAL
        self.read_error: str | None = None

    def write(self, event: str, **fields: Any) -> None:
        """Append one event. A full disk does not stop a study: the loss is kept in `read_error`."""
        entry = {"at": datetime.now(UTC).isoformat(timespec="seconds"), "event": event, **fields}
        line = json.dumps(entry, ensure_ascii=False) + "\n"
        try:
            descriptor = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
            try:
                os.write(descriptor, (_line_end(descriptor) + line).encode())
            finally:
                os.close(descriptor)
        except OSError as error:
            self.read_error = f"{self.path}: a line could not be written ({error.strerror})"


def _line_end(descriptor: int) -> str:
    size = os.fstat(descriptor).st_size
    return "\n" if size and os.pread(descriptor, 1, size - 1) != b"\n" else ""


def read(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries of a study's journal and a read error for each line that cannot be read."""
    entries: list[dict[str, Any]] = []
    read_errors: list[str] = []
    with suppress(FileNotFoundError):
        for number, line in enumerate((folder / JOURNAL).read_bytes().split(b"\n"), start=1):
            if not line.strip():
                continue
            try:
                entries.append(_checked(json.loads(line)))
            except (ValueError, RecursionError):
                read_errors.append(f"{JOURNAL}, line {number}: torn, passed over")
            except TypeError:
                read_errors.append(f"{JOURNAL}, line {number}: not an entry of a journal, passed over")
    return entries, read_errors


def _checked(entry: Any) -> dict[str, Any]:
    """The entry. Raises TypeError when it, its event, its case or its seconds are of another type, or no time."""
    if not isinstance(entry, dict) or not isinstance(entry.get("event"), str):
        raise TypeError("no event")
    if not isinstance(entry.get("case", ""), str):
        raise TypeError("no case")
    seconds = entry.get("seconds", 0.0)
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 <= seconds < inf:
        raise TypeError("no time")
    return entry


def seconds_by_case(entries: list[dict[str, Any]]) -> dict[str, float]:
    """Last known duration of each case, s: what time left is reckoned from."""
    return {
        entry["case"]: float(entry["seconds"])
        for entry in entries
        if entry.get("event") == "finished" and "case" in entry and "seconds" in entry
    }
