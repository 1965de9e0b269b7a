"""Rows of a result's document, one dictionary a row, units in the names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Document = dict[str, Any]
Rows = list[dict[str, Any]]


def response(document: Document) -> Rows:
    """One row a frequency."""
    names = ("zone_rms_m_per_V", "passive_rms_m_per_V", "zone_rms_error_m_per_V", "passive_rms_error_m_per_V")
    known = {name: document.get(name) for name in names}
    return [
        {"frequency_hz": frequency} | {name: values and values[place] for name, values in known.items()}
        for place, frequency in enumerate(document["frequency_hz"])
    ]


def tolerance(document: Document) -> Rows:
    """One row a sample."""
    return [dict(sample) for sample in document["samples"]]


def search(document: Document) -> Rows:
    """One row an evaluated design, its varied keys first."""
    return [
        each["set"]
        | {key: value for key, value in each.items() if key != "set"}
        | {"violations": "; ".join(each["violations"])}
        for each in document["evaluations"]
    ]


ROWS: dict[str, Callable[[Document], Rows]] = {
    each.__name__: each
    for each in (
        response,
        tolerance,
        search,
    )
}
