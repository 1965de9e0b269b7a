"""Shapes of the modes that carry most of the wanted one, small enough to stay in every record of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.layout import Design
from pipeline.modes import ModeRow, PartModes
from solvers.following import zone_coefficients

KEPT_MODES = 12
DIGITS = 5


def shapes_record(found: PartModes, design: Design) -> dict[str, Any]:
    """Shapes of the modes that carry most of the wanted one, on the active face, for the record."""
    assert found.wanted
    wanted = found.wanted.row
    assert wanted
    rows = sorted(found.wanted.rows, key=_score, reverse=True)[:KEPT_MODES]
    rows.sort(key=lambda row: row.frequency_hz)
    columns = [row.column for row in rows]
    touch = found.model.touch(wanted.parity, found.vectors[wanted.parity][:, columns])
    shapes = zone_coefficients(touch, design, wanted.parity)
    shapes = shapes / np.maximum(np.linalg.norm(shapes, axis=1, keepdims=True), 1e-300)
    return {
        "wanted": rows.index(wanted),
        "frequency_hz": [row.frequency_hz for row in rows],
        "share": [_share(row) for row in rows],
        "coefficients": [[float(f"{value:.{DIGITS}g}") for value in row] for row in shapes],
    }


def _share(row: ModeRow) -> float:
    return 1.0 if row.zone_share is None else row.zone_share


def _score(row: ModeRow) -> float:
    return (row.strength or 0.0) * (row.mac or 0.0) * _share(row)
