"""Shapes of a cell's Bloch waves for the page: a coarse skin moved by the lowest bands at the labelled wavevectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.coarse import coarse, with_sides
from solvers.superelement.lattice import Lattice
from solvers.waves.brillouin import Path

MOST_POINTS = 500
MOST_BANDS = 12


def wave_shapes(lattice: Lattice, path: Path, count: int) -> dict[str, Any]:
    """bands_* arrays: points (p, 3) in m, quads or triangles, labels (l,), u (l, bands, 2, p, 3): real and imaginary part.

    Each wave is scaled to a largest component of 1 and turned so that this one is real; half precision, for showing only.
    """
    skin = lattice.cell.skin
    assert skin.facets is not None
    facets = with_sides(skin.points, skin.facets, lattice.cell.size_m[2])
    kept, small = coarse(skin.points, facets, MOST_POINTS)
    labels = list(dict.fromkeys(label for label in path.labels if label))
    corners = [path.wavevectors[path.labels.index(label)] for label in labels]
    waves = [_waves(lattice, k, min(count, MOST_BANDS), skin.matrix[kept]) for k in corners]
    return {
        "bands_points": skin.points[kept].astype(np.float32),
        f"bands_{'quads' if small.shape[1] == 4 else 'triangles'}": small.astype(np.int32),
        "bands_labels": np.array(labels),
        "bands_u": np.stack(waves).astype(np.float16),
    }


def _waves(lattice: Lattice, k: FloatArray, count: int, matrix: FloatArray) -> FloatArray:
    """(count, 2, p, 3) of the lowest waves at one wavevector."""
    unknowns = lattice.waves(k, count).unknowns
    field = np.tensordot(matrix, unknowns, axes=(2, 0)).transpose(2, 0, 1)
    flat = field.reshape(len(field), -1)
    peak = flat[np.arange(len(flat)), np.argmax(np.abs(flat), axis=1)]
    field = field / peak[:, None, None]
    return np.stack([field.real, field.imag], axis=1)
