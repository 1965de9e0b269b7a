"""The thesis' figures beside those of a study's records; a figure that no record gives is left out."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

from pipeline.paths import REFERENCE
from pipeline.records.study import CONFINED_DB

FILE = REFERENCE / "thesis.csv"


def compare(records: list[dict[str, Any]], path: Path = FILE) -> list[dict[str, Any]]:
    """Rows {quantity, thesis, ours, unit, note} for every figure of the thesis that some record answers."""
    rows = []
    with path.open(newline="", encoding="utf-8") as file:
        for entry in csv.DictReader(file):
            ours = next((value for record in records if (value := _ours(entry, record)) is not None), None)
            if ours is not None:
                keys = ("quantity", "unit", "note")
                rows.append({key: entry[key] for key in keys} | {"thesis": _plain(entry["thesis"]), "ours": ours})
    return rows


def _plain(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _ours(entry: dict[str, str], record: dict[str, Any]) -> float | str | None:
    if not _same_design(entry, record.get("design") or {}):
        return None
    value = _figure(entry["key"], record)
    return round(value / 1e3, 3) if isinstance(value, float) else value


def _same_design(entry: dict[str, str], design: dict[str, Any]) -> bool:
    query = {"rows": 1.0, "pitch_mm": 1e3, "extension_mm": 1e3}
    names = {"rows": "rows", "pitch_mm": "pitch_x_m", "extension_mm": "extension_m"}
    return all(
        not entry[key] or math.isclose(float(entry[key]), factor * (design.get(names[key]) or 0.0), abs_tol=1e-6)
        for key, factor in query.items()
    )


def confinement_words(mode_db: float | None, driven_db: float | None) -> str | None:
    """Whether a plate holds its mode, as the thesis looked at it, and whether it does so driven; None without passive face."""
    if mode_db is None:
        return None
    said = f"{'confined' if mode_db >= CONFINED_DB else 'leaks'} ({mode_db:.1f} dB as a mode"
    if driven_db is None:
        return f"{said})"
    apart = mode_db >= CONFINED_DB > driven_db
    return f"{said}, {driven_db:.1f} dB driven by its patches{', which is not confined' if apart else ''})"


def _figure(key: str, record: dict[str, Any]) -> float | str | None:
    """A figure in Hz, or the verdict."""
    wanted, bands = record.get("wanted") or {}, record.get("bands") or {}
    gaps = bands.get("gaps") or [{}]
    zone, pillar = record.get("zone_modes") or {}, record.get("pillar_modes") or {}
    if key == "verdict":
        peak = (record.get("response") or {}).get("wanted_peak") or {}
        return confinement_words(wanted.get("confinement_db"), peak.get("confinement_db"))
    if key == "zone":
        return (zone.get("wanted") or {}).get("frequency_hz")
    if key == "pillar":
        return pillar["modes"][0]["frequency_hz"] if pillar else None
    if key == "bending":
        return bands["bending_at_m_hz"][0] if bands.get("bending_at_m_hz") else None
    if key == "formula":
        return ((record.get("predesign") or {}).get("zone") or {}).get("formula_hz")
    return {
        "wanted": wanted.get("frequency_hz"),
        "peak": ((record.get("response") or {}).get("wanted_peak") or {}).get("frequency_hz"),
        "gap_lower": gaps[0].get("lower_hz"),
        "gap_upper": gaps[0].get("upper_hz"),
    }[key]
