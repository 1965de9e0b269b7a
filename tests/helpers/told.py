"""A log that keeps what it is told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Told:
    """Facts in their order, alarms and omissions by name, and the steps."""

    def __init__(self) -> None:
        self.facts: list[str] = []
        self.alarms: dict[str, str] = {}
        self.omitted: dict[str, str] = {}
        self.steps: list[str] = []

    def info(self, text: str, id: str = "") -> None:
        self.facts.append(text)

    def alarm(self, id: str, text: str) -> None:
        self.alarms[id] = text

    def left_out(self, what: str, why: str) -> None:
        self.omitted[what] = why

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self.steps.append(name)
        yield
