"""The thesis' figures beside those of a study's records; a figure that no record gives is left out."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.paths import REFERENCE
from pipeline.quantity import Unit, frequency_figure, level
from pipeline.questions.bands import BandsResult
from pipeline.questions.predesign import PredesignResult
from pipeline.records.record import DesignRecord, Record
from pipeline.units import KHZ, MM
from solvers.measures.confinement import CONFINED_DB

FILE = REFERENCE / "thesis.csv"
TITLE = "Design of controlled localized mechanical waves: application to haptics"  # a doctoral thesis


def compare(records: list[Record], path: Path = FILE) -> list[dict[str, Any]]:
    """Rows {quantity, thesis, ours, shown (in words), unit, note} for every figure of the thesis that some record answers."""
    rows = []
    with path.open(newline="", encoding="utf-8") as file:
        for entry in csv.DictReader(file):
            found = next((pair for record in records if (pair := _ours(entry, record)) is not None), None)
            if found is not None:
                keys = ("quantity", "unit", "note")
                ours = {"ours": found[0], "shown": found[1]}
                rows.append({key: entry[key] for key in keys} | {"thesis": _plain(entry["thesis"])} | ours)
    return rows


def _plain(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _ours(entry: dict[str, str], record: Record) -> tuple[float | str, str] | None:
    """A figure of a record in kHz or a verdict, and the same in words; None where the record has none."""
    if record.design is None or not _same_design(entry, record.design):
        return None
    value, error = _figure(entry["key"], record)
    if not isinstance(value, float):
        return (value, value) if value else None
    return value / KHZ, frequency_figure(value, error, Unit("kHz", KHZ))


def _same_design(entry: dict[str, str], design: DesignRecord) -> bool:
    if design.graded_pillars:  # all rows of the thesis are alike
        return False
    ours = {
        "rows": design.rows,
        "pitch_mm": (design.pitch_x_m or 0.0) / MM,
        "extension_mm": (design.extension_m or 0.0) / MM,
    }
    return all(not entry[key] or math.isclose(float(entry[key]), value, abs_tol=1e-6) for key, value in ours.items())


def confinement_words(mode_db: float | None, driven_db: float | None, error_db: float | None = None) -> str | None:
    """Whether a plate confines its mode, as the thesis looked at it, and also as driven; None without passive face.

    error_db: half-width of the bar of the mode's level.
    """
    if mode_db is None:
        return None
    said = f"{'confined' if mode_db >= CONFINED_DB else 'leaks'} ({level(mode_db, error_db)} as a mode"
    if driven_db is None:
        return f"{said})"
    apart = mode_db >= CONFINED_DB > driven_db
    return f"{said}, {level(driven_db)} driven by its patches{', which is not confined' if apart else ''})"


def _figure(key: str, record: Record) -> tuple[float | str | None, float | None]:
    """A figure in Hz, or the verdict, and the half-width of its bar, relative."""
    wanted, bands, zone, pillar = (
        record.wanted,
        record.of(BandsResult),
        record.held("zone_modes"),
        record.held("pillar_modes"),
    )
    gap = bands.gaps[0] if bands and bands.gaps else None
    peak = record.response.wanted_peak if record.response else None
    known = record.of(PredesignResult)
    sizes = known.zone if known else None
    level_error, none = wanted.confinement_error_db if wanted else None, (None, None)
    figures: dict[str, Callable[[], tuple[float | str | None, float | None]]] = {
        "verdict": lambda: (confinement_words(record.confinement_db, record.driven_db, level_error), None),
        "zone": lambda: (zone.wanted.frequency_hz, zone.wanted.frequency_error) if zone and zone.wanted else none,
        "pillar": lambda: (pillar.modes[0].frequency_hz, pillar.modes[0].error) if pillar else none,
        "bending": lambda: (
            (bands.bending_at_m_hz[0], bands.bending_errors[0]) if bands and bands.bending_at_m_hz else none
        ),
        "formula": lambda: (sizes.formula_hz, None) if sizes else none,
        "wanted": lambda: (wanted.frequency_hz, wanted.frequency_error) if wanted else none,
        "peak": lambda: (peak.frequency_hz, peak.frequency_error) if peak else none,
        "gap_lower": lambda: (gap.lower_hz, gap.lower_error) if gap else none,
        "gap_upper": lambda: (gap.upper_hz, gap.upper_error) if gap else none,
    }
    return figures[key]()
