"""Rows as pandas tables and xarray datasets, units in the names and in the attributes."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from types import ModuleType
from typing import Any

UNITS = {
    "hz": "Hz", "khz": "kHz", "db": "dB", "m": "m", "mm": "mm", "kg": "kg", "per_m": "rad/m", "m_per_V": "m/V",
    "GPa": "GPa", "deg": "deg",
}  # fmt: skip


def unit_of(name: str) -> str | None:
    """The unit at the end of a column's name; None for a name without one.

    >>> from pipeline.records.frames import unit_of
    >>> unit_of("zone_rms_m_per_V"), unit_of("kx_per_m"), unit_of("mac")
    ('m/V', 'rad/m', None)
    """
    ends = [end for end in UNITS if name.endswith(f"_{end}")]
    return UNITS[max(ends, key=len)] if ends else None


def frame(rows: Sequence[dict[str, Any]], heading: Sequence[str] = ()) -> Any:
    """The rows as a pandas DataFrame, of these columns where there is no row. Raises ImportError without pandas."""
    return _needed("pandas").DataFrame(list(rows), columns=None if rows else list(heading))


def dataset(rows: Sequence[dict[str, Any]], dimensions: Sequence[str]) -> Any:
    """The rows as an xarray Dataset over columns that number them; `units` in the attributes.

    Raises ImportError without pandas and xarray.
    """
    _needed("xarray")
    data = frame(rows).set_index(list(dimensions)).to_xarray()
    for name, variable in data.variables.items():
        if unit := unit_of(str(name)):
            variable.attrs["units"] = unit
    return data


def html_table(names: Sequence[str], rows: Sequence[Sequence[Any]], marked: Collection[int] = ()) -> str:
    """Rows as an HTML table with units in its head, digits by the bars; the `marked` ones in bold with a star.

    >>> from pipeline.records.frames import html_table
    >>> html_table(["confinement_db"], [[11.52], [None]], [0])[-66:]
    '<tr><td><b>11.5 *</b></td></tr><tr><td>-</td></tr></tbody></table>'
    """
    from html import escape

    from pipeline.records.outputs import cells as in_words

    words, shown = in_words(names, rows)
    head = "".join(f"<th>{escape(each)}</th>" for each in words)
    lines = []
    for number, row in enumerate(shown):
        cells = [escape(str("-" if value is None else value)) for value in row]
        if number in marked:
            cells = [f"<b>{cell}{' *' if place == 0 else ''}</b>" for place, cell in enumerate(cells)]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"


def _needed(name: str) -> ModuleType:
    from importlib import import_module

    try:
        return import_module(name)
    except ModuleNotFoundError as fault:
        raise ImportError(f"tables need {fault.name}: pip install 'antinode[tables]'") from fault
