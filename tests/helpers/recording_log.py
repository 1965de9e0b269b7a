"""A log that records its messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class RecordingLog:
    """Facts in their order, warnings and simplifications by name, and the steps."""

    def __init__(self) -> None:
        self.facts: list[str] = []
        self.warnings: dict[str, str] = {}
        self.omitted: dict[str, str] = {}
        self.steps: list[str] = []

    def info(self, text: str, id: str = "") -> None:
        self.facts.append(text)

    def warning(self, id: str, text: str) -> None:
        self.warnings[id] = text

    def left_out(self, what: str, why: str) -> None:
        self.omitted[what] = why

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self.steps.append(name)
        yield
