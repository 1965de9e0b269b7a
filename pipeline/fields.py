"""Fields of a plate's modes: what a record keeps for its page, the same unfolded for drawing, and everything on demand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.folded import folded, surface_arrays, unfolded
from pipeline.modes import PartModes
from solvers.fem.surface import Skin

__all__ = ["full_fields", "kept_arrays", "plate_arrays", "surface_arrays"]


def kept_arrays(found: PartModes, rows: Sequence[int]) -> dict[str, Any]:
    """folded_* arrays of the chosen modes, the first one being the wanted mode."""
    skins = [_skin(found, index) for index in rows]
    chosen = [found.rows[index] for index in rows]
    return folded(skins, [row.parity for row in chosen], np.array([row.frequency_hz for row in chosen]))


def plate_arrays(found: PartModes, rows: Sequence[int]) -> dict[str, Any]:
    """surface_*, touch_* and mesh_* arrays of the chosen modes, as pictures read them."""
    return unfolded(kept_arrays(found, rows))


def full_fields(found: PartModes) -> dict[str, Any]:
    """Every mode on the skin that was meshed: points (p, 3) in m, facets, frequency_hz and parity (k,), displacement (k, p, 3).

    M-orthonormal in the model's scaled units; a quarter where a parity is given: u_z is even (+) or odd (-) in x, then y.
    """
    skins = [_skin(found, index) for index in range(len(found.rows))]
    if not skins:
        return {}
    return {
        "points": skins[0].points,
        "facets": skins[0].facets.astype(np.int32),
        "frequency_hz": np.array([row.frequency_hz for row in found.rows]),
        "parity": np.array([row.parity or "" for row in found.rows]),
        "displacement": np.concatenate([skin.displacement for skin in skins]),
    }


def _skin(found: PartModes, index: int) -> Skin:
    row = found.rows[index]
    return found.model.skin(row.parity, found.vectors[row.parity][:, [row.column]])
