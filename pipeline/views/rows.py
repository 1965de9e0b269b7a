"""Rows of a result's document, one dictionary a row, units in the names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Document = dict[str, Any]
Rows = list[dict[str, Any]]


def touch(document: Document) -> Rows:
    """One row a state: the free plate, the finger at constant voltage, retuned, held by the loop, with shaped voltages."""
    return [dict(state) for state in document["states"]]


def hybrid(document: Document) -> Rows:
    """One row a frequency: of each method the level in dB, with every resonance or the pillars' alone off, and V for 1 um."""
    keys = {"confinement_db": "db", "off_db": "off_db", "rows_off_db": "rows_off_db", "volts_per_um": "volts_per_um"}
    keys |= {
        "confinement_error_db": "error_db",
        "off_error_db": "off_error_db",
        "rows_off_error_db": "rows_off_error_db",
    }
    keys |= {"volts_error_per_um": "volts_error_per_um"}
    return [
        {"frequency_hz": frequency}
        | {
            f"{method['method']}_{name}": method[key][place]
            for method in document["methods"]
            for key, name in keys.items()
            if method.get(key) is not None
        }
        for place, frequency in enumerate(document["frequency_hz"])
    ]


def travel(document: Document) -> Rows:
    """One row a place of the zone's centre line: u_z for 1 um rms in the zone, real, imaginary, size and its bar, m."""
    errors = document.get("field_error_m") or [None] * len(document["x_m"])
    places = zip(document["x_m"], document["field_m"], errors, strict=True)
    return [
        {"x_m": x, "re_m": re, "im_m": im, "size_m": abs(complex(re, im)), "size_error_m": error}
        for x, (re, im), error in places
    ]


ROWS: dict[str, Callable[[Document], Rows]] = {
    each.__name__: each
    for each in (
        touch,
        hybrid,
        travel,
    )
}
