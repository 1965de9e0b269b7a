"""Shapes of the modes that look most like the wanted one, small enough to stay in every record of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.layout import Design
from pipeline.modes import PartModes
from solvers.following import zone_coefficients

KEPT_MODES = 12
DIGITS = 5


def shapes_record(found: PartModes, index: int, design: Design) -> dict[str, Any]:
    """Shapes of the modes that look most like the wanted one, on the active face, for the record."""
    wanted = found.rows[index]
    rows = [i for i, row in enumerate(found.rows) if row.parity == wanted.parity]
    rows = sorted(rows, key=lambda i: -_score(found, i))[:KEPT_MODES]
    rows.sort()
    columns = [found.rows[i].column for i in rows]
    touch = found.model.touch(wanted.parity, found.vectors[wanted.parity][:, columns])
    shapes = zone_coefficients(touch, design, wanted.parity)
    shapes = shapes / np.maximum(np.linalg.norm(shapes, axis=1, keepdims=True), 1e-300)
    return {
        "wanted": rows.index(index),
        "frequency_hz": [found.rows[i].frequency_hz for i in rows],
        "share": [_share(found, i) for i in rows],
        "coefficients": [[float(f"{value:.{DIGITS}g}") for value in row] for row in shapes],
    }


def _share(found: PartModes, index: int) -> float:
    share = found.rows[index].zone_share
    return 1.0 if share is None else share


def _score(found: PartModes, index: int) -> float:
    return (found.rows[index].mac or 0.0) * _share(found, index)
