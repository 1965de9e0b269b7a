"""Storage of surfaces with mode shapes: the meshed quarter, displacements as small integers, bytes sorted by weight.

A record stores only what its page shows: displacements to 1/8190 of each mode's maximum, which no picture resolves.
Sorted bytes compress better, since the high bytes of neighbouring points are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray
from solvers.fem.surface import Skin, triangles

FULL = 4095  # steps per largest displacement: finer ones are incompressible noise
FLAT = 1e-9  # m: corners of the touch face lie on z = 0
PREFIX = "folded_"


def folded(skins: Sequence[Skin], symmetries: Sequence[str | None], frequency_hz: FloatArray) -> dict[str, Any]:
    """Return folded_* arrays of surfaces with common points, one per mode, displacements scaled to a maximum of 1."""
    first = skins[0]
    return {
        f"{PREFIX}points": first.points.astype(np.float32),
        f"{PREFIX}{_kind(first)}": first.facets.astype(np.int32),
        f"{PREFIX}u": np.stack([in_steps(scaled(skin.displacement[0])) for skin in skins]),
        f"{PREFIX}symmetry": np.array([symmetry or "" for symmetry in symmetries]),
        "surface_frequency_hz": np.asarray(frequency_hz, dtype=float),
    }


def unfolded(arrays: dict[str, Any]) -> dict[str, Any]:
    """Replace folded_* by surface_*, touch_* and mesh_* arrays of the whole plate; others stay unchanged."""
    if f"{PREFIX}points" not in arrays:
        return arrays
    kept = {name: array for name, array in arrays.items() if not name.startswith(PREFIX)}
    kind = "quads" if f"{PREFIX}quads" in arrays else "triangles"
    points, facets = arrays[f"{PREFIX}points"].astype(float), arrays[f"{PREFIX}{kind}"]
    quarter = [
        Skin(points, facets, from_steps(u)[None]).unfolded(str(symmetry) or None)
        for u, symmetry in zip(arrays[f"{PREFIX}u"], arrays[f"{PREFIX}symmetry"], strict=True)
    ]
    symmetry = {"surface_symmetry": arrays[f"{PREFIX}symmetry"]}
    return kept | moving(quarter) | symmetry | {"mesh_points": points, f"mesh_{kind}": facets}


def moving(skins: Sequence[Skin]) -> dict[str, Any]:
    """Return surface_* and touch_* arrays of whole surfaces with common points."""
    return surface_arrays(skins) | touch_arrays(skins)


def surface_arrays(skins: Sequence[Skin]) -> dict[str, Any]:
    """Return surface_* arrays of shapes on common points, each scaled to a largest component of 1."""
    moved = np.concatenate([scaled(skin.displacement) for skin in skins]).astype(np.float32)
    return {
        "surface_points": skins[0].points,
        f"surface_{_kind(skins[0])}": skins[0].facets.astype(np.int32),
        "surface_u": moved,
    }


def touch_arrays(skins: Sequence[Skin]) -> dict[str, Any]:
    """Return the triangulated touch face (z = 0) with u_z of every mode."""
    skin = skins[0]
    on_face = (np.abs(skin.points[:, 2]) < FLAT)[skin.facets].all(axis=1)
    facets = skin.facets[on_face]
    corners = triangles(facets)
    used, local = np.unique(corners, return_inverse=True)
    return {
        "touch_xy": skin.points[used, :2],
        "touch_triangles": local.reshape(corners.shape).astype(np.int32),
        "touch_uz": np.stack([scaled(s.displacement)[0, used, 2] for s in skins]).astype(np.float32).astype(np.float64),
    }


def scaled(displacement: FloatArray) -> FloatArray:
    """Scale modes, whose amplitude is arbitrary, to a largest component of 1."""
    return displacement / max(float(np.abs(displacement).max()), 1e-300)


def in_steps(values: FloatArray) -> NDArray[np.uint8]:
    """Encode numbers within +-1 as steps in two planes of bytes, low and high, shape (2, *values.shape)."""
    numbers = np.round(values * FULL).astype("<i2")
    return np.ascontiguousarray(np.moveaxis(numbers.view(np.uint8).reshape(*values.shape, 2), -1, 0))


def from_steps(planes: NDArray[np.uint8]) -> FloatArray:
    """Decode in_steps, to half a step."""
    numbers = np.ascontiguousarray(np.moveaxis(planes, 0, -1)).view("<i2")[..., 0]
    return numbers.astype(float) / FULL


def _kind(skin: Skin) -> str:
    return "quads" if skin.facets.shape[1] == 4 else "triangles"
