"""Tables for people: frequencies in kHz, units in the head line, few digits, the row that answers marked.

CSV and JSON keep full figures in SI units under the same names.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from pipeline.records.outputs import markdown, table

DIGITS = ".4g"


class Form(NamedTuple):
    """How figures of a name are shown: unit, factor and format."""

    unit: str
    factor: float = 1.0
    digits: str = DIGITS


ENDINGS = {
    "_hz": Form("kHz", 1e-3, ".3f"),
    "_rms_m_per_V": Form("nm/V", 1e9),
    "_rms_m_per_N": Form("nm/N", 1e9),
    "_per_m": Form("rad/m", 1.0, ".1f"),
    "_db": Form("dB", 1.0, "z.1f"),
    "_mm": Form("mm", 1.0, ".3f"),
}
KHZ, MS = ENDINGS["_hz"], Form("ms", 1e3, ".3f")
NAMES = {
    "db_per_row": ("decay per row", Form("dB", 1.0, ".2f")),
    "formula_hz": ("beam formula", KHZ),
    "pinned_hz": ("pinned sides (Mindlin)", KHZ),
    "thin_clamped_hz": ("clamped sides (thin plate)", KHZ),
    "clamped_hz": ("clamped sides (Mindlin)", KHZ),
    "timoshenko_height_mm": ("height (Timoshenko)", ENDINGS["_mm"]),
    "given_euler_hz": ("given (Euler)", KHZ),
    "given_timoshenko_hz": ("given (Timoshenko)", KHZ),
    "gain_n_m": ("gain K'", Form("N/m")),
    "largest_force_n": ("largest force", Form("N")),
    "reached_95_s": ("95 % reached", MS),
    "settled_5_s": ("settled within 5 %", MS),
    "limited_periods": ("saturated periods", Form("")),
    "mass_g": ("mass", Form("g")),
    "band_khz": ("stop band", Form("kHz")),
    "given_second_hz": ("given, second bending", KHZ),
}
UNREAD = ("residual",)  # for whoever checks a solver: in files alone
OF_ITS_OWN = ("quantity", "value")  # a row's name of a figure, and the figure


def named(name: str) -> tuple[str, Form]:
    """The words and the form of a figure by its name in files: band_1_hz -> band 1, in kHz."""
    if name in NAMES:
        return NAMES[name]
    if (figure := name.removesuffix("_error")) in NAMES:
        return f"{NAMES[figure][0]}: expected error", Form("")
    ending = next((ending for ending in ENDINGS if name.endswith(ending)), "")
    return name.removesuffix(ending).replace("_", " "), ENDINGS.get(ending, Form(""))


def shown(value: Any, form: Form) -> str | None:
    """A figure in its form; what is no floating-point number as it is."""
    return f"{form.factor * value:{form.digits}}" if isinstance(value, float) else value


def filled(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Head and rows without the columns that nobody reads or that have no meaning here: nothing in any row."""
    some = [at for at in range(len(head)) if not rows or any(row[at] is not None for row in rows)]
    kept = [at for at in some if head[at] not in UNREAD]
    return [head[at] for at in kept], [[row[at] for at in kept] for row in rows]


def reading_table(head: Sequence[str], rows: Iterable[Sequence[Any]], marked: Collection[int] = ()) -> str:
    """Aligned columns under words with units; the rows whose numbers are `marked` begin with a star."""
    first, *lines = table(*_in_words(head, rows)).splitlines()
    if not marked:
        return "\n".join([first, *lines])
    return "\n".join([f"  {first}", *(f"{'*' if i in marked else ' '} {line}" for i, line in enumerate(lines))])


def reading_markdown(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """The same as a table in Markdown, without the columns that are empty."""
    heading, cells = _in_words(*filled(head, rows))
    return markdown(heading, [["-" if cell is None else str(cell) for cell in row] for row in cells])


def _in_words(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    if set(OF_ITS_OWN) <= set(head):
        rows = [_one_quantity(dict(zip(head, row, strict=True))) for row in rows]
    known = [named(name) for name in head]
    heading = [f"{words} ({form.unit})" if form.unit else words for words, form in known]
    return heading, [[shown(value, form) for value, (_, form) in zip(row, known, strict=True)] for row in rows]


def _one_quantity(row: dict[str, Any]) -> list[Any]:
    name, value = (row[key] for key in OF_ITS_OWN)
    words, form = named(name)
    return [
        *(row | {"quantity": f"{words} ({form.unit})" if form.unit else words, "value": shown(value, form)}).values()
    ]
