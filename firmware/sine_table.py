"""Writes core/an_sine_table.inc: the unit circle at 256 evenly spaced angles, from 0."""

from __future__ import annotations

import math
from pathlib import Path

PATH = Path(__file__).parent / "core" / "an_sine_table.inc"


def text(sectors: int = 256) -> str:
    """One C initialiser {cosine, sine} a line, nine digits: enough to name any single-precision number."""
    angles = [2.0 * math.pi * index / sectors for index in range(sectors)]
    return "".join(f"{{{math.cos(angle):.9e}f, {math.sin(angle):.9e}f}},\n" for angle in angles)


if __name__ == "__main__":
    PATH.write_text(text())
