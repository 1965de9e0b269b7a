"""Tables for people: frequencies in kHz, units in the head line, few digits, the row that answers marked.

CSV and JSON keep full figures in SI units under the same names.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from pipeline.records.outputs import table

DIGITS = ".4g"


class Form(NamedTuple):
    """How figures of a name are shown: unit, factor and format."""

    unit: str
    factor: float = 1.0
    digits: str = DIGITS


ENDINGS = {
    "_hz": Form("kHz", 1e-3, ".3f"),
    "_rms_m_per_V": Form("nm/V", 1e9),
    "_per_m": Form("rad/m", 1.0, ".1f"),
    "_db": Form("dB", 1.0, ".1f"),
    "_mm": Form("mm", 1.0, ".3f"),
}
NAMES = {"db_per_row": ("decay per row", Form("dB", 1.0, ".2f"))}


def named(name: str) -> tuple[str, Form]:
    """The words and the form of a figure by its name in files: band_1_hz -> band 1, in kHz."""
    if name in NAMES:
        return NAMES[name]
    ending = next((ending for ending in ENDINGS if name.endswith(ending)), "")
    return name.removesuffix(ending).replace("_", " "), ENDINGS.get(ending, Form(""))


def shown(value: Any, form: Form) -> str | None:
    """A figure in its form; what is no floating-point number as it is."""
    return f"{form.factor * value:{form.digits}}" if isinstance(value, float) else value


def filled(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Head and rows without the columns that have no meaning here: nothing in any row."""
    kept = [at for at in range(len(head)) if not rows or any(row[at] is not None for row in rows)]
    return [head[at] for at in kept], [[row[at] for at in kept] for row in rows]


def reading_table(head: Sequence[str], rows: Iterable[Sequence[Any]], marked: Collection[int] = ()) -> str:
    """Aligned columns under words with units; the rows whose numbers are `marked` begin with a star."""
    known = [named(name) for name in head]
    heading = [f"{words} ({form.unit})" if form.unit else words for words, form in known]
    cells = [[shown(value, form) for value, (_, form) in zip(row, known, strict=True)] for row in rows]
    first, *lines = table(heading, cells).splitlines()
    if not marked:
        return "\n".join([first, *lines])
    return "\n".join([f"  {first}", *(f"{'*' if i in marked else ' '} {line}" for i, line in enumerate(lines))])
