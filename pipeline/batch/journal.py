"""journal.jsonl: what happened to a study, one JSON object a line, only ever appended to."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

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


class Entry(BaseModel):
    """A line of a journal: what happened, to which case, and the seconds that it took."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)

    event: str
    case: str = ""
    seconds: float = Field(default=0.0, ge=0.0)


def read(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries of a study's journal and a read error for each line that cannot be read."""
    entries: list[dict[str, Any]] = []
    read_errors: list[str] = []
    with suppress(FileNotFoundError):
        for number, line in enumerate((folder / JOURNAL).read_bytes().split(b"\n"), start=1):
            if not line.strip():
                continue
            try:
                entries.append(Entry.model_validate_json(line).model_dump(exclude_unset=True))
            except ValidationError as error:
                torn = error.errors()[0]["type"] == "json_invalid"
                why = "torn" if torn else "not an entry of a journal"
                read_errors.append(f"{JOURNAL}, line {number}: {why}, passed over")
    return entries, read_errors


def seconds_by_case(entries: list[dict[str, Any]]) -> dict[str, float]:
    """Last known duration of each case, s: what time left is reckoned from."""
    return {
        entry["case"]: float(entry["seconds"])
        for entry in entries
        if entry.get("event") == "finished" and "case" in entry and "seconds" in entry
    }
