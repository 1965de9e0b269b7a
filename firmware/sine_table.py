"""Write core/an_sine_table.inc: cosine and sine at 256 equally spaced angles, starting at 0."""

from __future__ import annotations

import math
from pathlib import Path

PATH = Path(__file__).parent / "core" / "an_sine_table.inc"


def text(sectors: int = 256) -> str:
    """Return one C initialiser {cosine, sine} per line, with ten digits, enough for an exact single-precision value."""
    angles = [2.0 * math.pi * index / sectors for index in range(sectors)]
    return "".join(f"{{{math.cos(angle):.9e}f, {math.sin(angle):.9e}f}},\n" for angle in angles)


if __name__ == "__main__":
    PATH.write_text(text())
