"""Tables for people: as many digits as a figure's bar allows, units in the head line, the row that answers marked.

A figure's bar stands in the same row: `error` of `frequency_hz`, `band_1_error` of `band_1_hz` (relative), `mac_error` of
`mac`, `confinement_error_db` of `confinement_db` (in its own unit). A figure without a bar has few digits, and what was given
has six at most. CSV and JSON keep full figures in SI units under the same names.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from pipeline import quantity
from pipeline.quantity import Unit
from pipeline.records.outputs import markdown, table

RIGID = 1e-4  # of the largest frequency of a table: with a bar of 0 below it, a rigid-body wave at rest


class Form(NamedTuple):
    """How figures of a name are shown where no bar says more: unit, factor, and whether they were given, not computed."""

    unit: str
    factor: float = 1.0
    is_given: bool = False


PERCENT = Form("%", 100.0)
GIVEN_HZ = Form("kHz", 1e-3, is_given=True)
ENDINGS = {
    "_error_db": Form("dB"),
    "_error": PERCENT,
    "_hz": Form("kHz", 1e-3),
    "_rms_m_per_V": Form("nm/V", 1e9),
    "_rms_m_per_N": Form("nm/N", 1e9),
    "_per_m": Form("rad/m"),
    "_db": Form("dB"),
    "_mm": Form("mm", is_given=True),
}
KHZ, MS = ENDINGS["_hz"], Form("ms", 1e3)
NAMES = {
    "frequency_hz": ("frequency", GIVEN_HZ),
    "detuning_hz": ("detuning", GIVEN_HZ),
    "kx_per_m": ("kx", Form("rad/m", is_given=True)),
    "ky_per_m": ("ky", Form("rad/m", is_given=True)),
    "db_per_row": ("decay per row", Form("dB")),
    "quality_error": ("± quality factor", Form("")),
    "db_error": ("± decay per row", Form("dB")),
    "formula_hz": ("beam formula", KHZ),
    "pinned_hz": ("pinned sides (Mindlin)", KHZ),
    "thin_clamped_hz": ("clamped sides (thin plate)", KHZ),
    "clamped_hz": ("clamped sides (Mindlin)", KHZ),
    "timoshenko_height_mm": ("height (Timoshenko)", ENDINGS["_mm"]),
    "given_euler_hz": ("given (Euler)", KHZ),
    "given_timoshenko_hz": ("given (Timoshenko)", KHZ),
    "gain_n_m": ("gain K'", Form("N/m", is_given=True)),
    "largest_force_n": ("largest force", Form("N")),
    "reached_95_s": ("95 % reached", MS),
    "settled_5_s": ("settled within 5 %", MS),
    "limited_periods": ("saturated periods", Form("")),
    "mass_g": ("mass", Form("g")),
    "band_khz": ("stop band", Form("kHz")),
    "given_second_hz": ("given, second bending", KHZ),
    "allowed": ("allowed", PERCENT),
    "young_GPa": ("young GPa", Form("", is_given=True)),
    "density_kg_m3": ("density kg m3", Form("", is_given=True)),
    "poisson": ("poisson", Form("", is_given=True)),
}
UNREAD = ("residual",)  # for whoever checks a solver: in files alone
# bars that decide digits, and stand in files alone
UNREAD_BARS = re.compile(r"band_\d+_error|(zone_share|mac|strength)_error")
OF_ITS_OWN = ("quantity", "value")  # a row's name of a figure, and the figure
BARS = {  # named after more than their figure
    "frequency_hz": "error",
    "db_per_row": "db_error",
    "quality_factor": "quality_error",
    "reference_hz": "allowed",
    "found_hz": "allowed",
}


def named(name: str) -> tuple[str, Form]:
    """The words and the form of a figure by its name in files: band_1_hz -> band 1, in kHz."""
    if name in NAMES:
        return NAMES[name]
    if name == "error":
        return "± error", PERCENT
    if (figure := name.removesuffix("_error")) in NAMES:
        return f"{NAMES[figure][0]}: expected error", PERCENT
    ending = next((ending for ending in ENDINGS if name.endswith(ending)), "")
    words = name.removesuffix(ending).replace("_", " ").strip()
    return f"± {words}".strip() if "error" in ending else words, ENDINGS.get(ending, Form(""))


def bar_of(name: str, head: Collection[str]) -> str | None:
    """The column that holds a figure's bar; None where there is none."""
    if "error" in name:
        return None
    parts = name.split("_")
    within = ("_".join([*parts[:i], "error", *parts[i:]]) for i in range(1, len(parts) + 1))
    tried = (*([f"{name.removesuffix('_hz')}_error"] if name.endswith("_hz") else ()), *within, BARS.get(name, ""))
    return next((bar for bar in tried if bar in head), None)


def is_relative(name: str, bar: str) -> bool:
    """Whether a figure's bar is relative: that of a frequency, where it has no unit of its own."""
    return name.endswith("_hz") and not bar.endswith("_hz")


def shown(name: str, value: Any, form: Form) -> Any:
    """A figure without a bar in its form, a bar with its own digits; what is no floating-point number as it is."""
    if not isinstance(value, float):
        return value
    if form.unit == "%":
        return quantity.percent(value).removesuffix(" %")
    if form.is_given:
        return f"{form.factor * value:g}"
    if "error" in name:
        return quantity.figure(form.factor * value, form.factor * value)
    return quantity.level_figure(value) if form.unit == "dB" else quantity.figure(form.factor * value)


def frequency_unit(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Unit:
    """The unit of all frequencies of a table: that of the largest."""
    values = [value for row in rows for name, value in zip(head, row, strict=True) if name.endswith("_hz")]
    known = [value for value in values if isinstance(value, float)]
    return quantity.frequency_unit(known) if known else Unit(ENDINGS["_hz"].unit, 1.0 / ENDINGS["_hz"].factor)


def cells(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Words with units for a head, and rows of figures with the digits that their bars allow; None stays None."""
    unit = frequency_unit(head, rows)
    known = {name: _in_unit(form, unit) if name.endswith("_hz") else form for name in head for form in [named(name)[1]]}
    read = [name for at, name in enumerate(head) if not (UNREAD_BARS.fullmatch(name) or _is_empty_bar(name, at, rows))]
    words = [f"{named(name)[0]} ({known[name].unit})" if known[name].unit else named(name)[0] for name in read]
    bars = {name: bar_of(name, head) for name in head}
    largest = max(
        (abs(v) for row in rows for n, v in zip(head, row, strict=True) if n.endswith("_hz") and v), default=0.0
    )

    def cell(name: str, row: Mapping[str, Any]) -> Any:
        value, form, bar = row[name], known[name], bars[name]
        if bar is None or not isinstance(value, float):
            return shown(name, value, form)
        own = row[bar]
        if own == 0.0 == value:
            return "0"
        if name.endswith("_hz") and is_relative(name, bar):
            at_rest = not value or (own == 0.0 and abs(value) < RIGID * largest)
            return "0" if at_rest else quantity.frequency_figure(value, own, unit)
        scaled = [None if each is None else form.factor * each for each in (value, own)]
        return quantity.level_figure(*scaled) if form.unit == "dB" else quantity.figure(*scaled)

    named_rows = (dict(zip(head, row, strict=True)) for row in rows)
    return words, [[cell(name, row) for name in read] for row in named_rows]


def _is_empty_bar(name: str, at: int, rows: Sequence[Sequence[Any]]) -> bool:
    return "error" in name and len(rows) > 0 and all(row[at] is None for row in rows)


def _in_unit(form: Form, unit: Unit) -> Form:
    return form._replace(unit=unit.symbol, factor=1.0 / unit.size)


def filled(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> tuple[list[str], list[list[Any]]]:
    """Head and rows without the columns that nobody reads or that have no meaning here: nothing in any row.

    An empty column of bars stays: its figures have no estimate, and the digits of such.
    """
    bars = {bar_of(name, head) for name in head}
    some = [at for at in range(len(head)) if not rows or head[at] in bars or any(row[at] is not None for row in rows)]
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
    if not set(OF_ITS_OWN) <= set(head):
        return cells(head, list(rows))
    each = [dict(zip(head, row, strict=True)) for row in rows]
    known = {(row.get("part"), row["quantity"]): row["value"] for row in each}
    bars = [known.get((row.get("part"), f"{row['quantity']}_error")) for row in each]
    return cells(head, [_one_quantity(row, bar) for row, bar in zip(each, bars, strict=True)])


def _one_quantity(row: dict[str, Any], bar: float | None) -> list[Any]:
    """A row in its own figure's unit; of a part by theory, which has no bar, a figure has few digits."""
    name, value = (row[key] for key in OF_ITS_OWN)
    words, form = named(name)
    text: Any = shown(name, value, form)
    if "part" in row and isinstance(value, float) and "error" not in name:
        unit = quantity.frequency_unit([value]) if name.endswith("_hz") else Unit(form.unit, 1.0 / form.factor)
        form, scaled = _in_unit(form, unit), value / unit.size
        text = quantity.figure(scaled, None if bar is None else abs(scaled) * bar)
    return [*(row | {"quantity": f"{words} ({form.unit})" if form.unit else words, "value": text}).values()]
