"""What the thesis states beside what is computed here."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

NEAR = 0.15  # relative: a figure read from the text has one or two digits


@dataclass(frozen=True)
class Entry:
    """One quantity: the thesis' value, ours, and a line on their agreement."""

    quantity: str
    thesis: str
    ours: str
    agreement: str

    def as_json(self) -> dict[str, Any]:
        """The four texts."""
        return asdict(self)


def agreement(ours: float, thesis: float) -> str:
    """Agreement of two numbers in words: agrees within 15 %, else by how much ours is off."""
    change = ours / thesis - 1.0
    return f"{'agrees' if abs(change) <= NEAR else 'differs'}: ours is {100.0 * change:+.0f} % off"
