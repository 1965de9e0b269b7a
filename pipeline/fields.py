"""Arrays that pictures are drawn from: the moving skin of the whole plate and the normal field of its touch face."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.modes import PartModes
from solvers.fem.surface import Skin

FLAT = 1e-9  # m: corners of the touch face lie on z = 0


def plate_arrays(found: PartModes, rows: list[int]) -> dict[str, Any]:
    """surface_*, touch_* and mesh_* arrays of the chosen modes, the first one being the wanted mode."""
    skins = [_skin(found, index) for index in rows]
    first = skins[0]
    whole = [skin.unfolded(found.rows[index].parity) for skin, index in zip(skins, rows, strict=True)]
    arrays = surface_arrays(whole) | {
        "surface_frequency_hz": np.array([found.rows[index].frequency_hz for index in rows])
    }
    arrays |= touch_arrays(whole)
    kind = "quads" if first.facets.shape[1] == 4 else "triangles"
    return arrays | {"mesh_points": first.points, f"mesh_{kind}": first.facets}


def _skin(found: PartModes, index: int) -> Skin:
    row = found.rows[index]
    return found.model.skin(row.parity, found.vectors[row.parity][:, [row.column]])


def surface_arrays(skins: list[Skin]) -> dict[str, Any]:
    """surface_* arrays of moving skins that share their points, each scaled to a largest component of 1."""
    kind = "quads" if skins[0].facets.shape[1] == 4 else "triangles"
    moved = np.concatenate([_scaled(skin.displacement) for skin in skins]).astype(np.float32)
    return {
        "surface_points": skins[0].points,
        f"surface_{kind}": skins[0].facets.astype(np.int32),
        "surface_u": moved,
    }


def _scaled(displacement: FloatArray) -> FloatArray:
    """Modes have no amplitude of their own: the largest component becomes 1."""
    return displacement / max(float(np.abs(displacement).max()), 1e-300)


def touch_arrays(skins: list[Skin]) -> dict[str, Any]:
    """Triangulated touch face (z = 0) with u_z of every mode."""
    skin = skins[0]
    on_face = (np.abs(skin.points[:, 2]) < FLAT)[skin.facets].all(axis=1)
    facets = skin.facets[on_face]
    triangles = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]]) if facets.shape[1] == 4 else facets
    used, local = np.unique(triangles, return_inverse=True)
    return {
        "touch_xy": skin.points[used, :2],
        "touch_triangles": local.reshape(triangles.shape).astype(np.int32),
        "touch_uz": np.stack([_scaled(s.displacement)[0, used, 2] for s in skins])
        .astype(np.float32)
        .astype(np.float64),
    }
