"""Fields and shapes of computed modes in their stored form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.models.modes import PartModes
from pipeline.records.surface_codec import folded, surface_arrays, unfolded
from solvers.fem.surface import Skin
from solvers.measures.correlation import zone_coefficients
from solvers.measures.target_mode import weights

if TYPE_CHECKING:
    from solvers.piezo.forced import ForcedPlate

__all__ = ["full_fields", "kept_arrays", "plate_arrays", "surface_arrays"]
KEPT_MODES = 12


def kept_arrays(part_modes: PartModes, rows: Sequence[int]) -> dict[str, Any]:
    """Return the folded_* arrays of the chosen modes; the first is the target mode."""
    skins = [_skin(part_modes, index) for index in rows]
    chosen = [part_modes.rows[index] for index in rows]
    return folded(skins, [row.symmetry for row in chosen], np.array([row.frequency_hz for row in chosen]))


def plate_arrays(part_modes: PartModes, rows: Sequence[int]) -> dict[str, Any]:
    """Return the surface_*, touch_* and mesh_* arrays of the chosen modes in the form that figures read."""
    return unfolded(kept_arrays(part_modes, rows))


def full_fields(part_modes: PartModes) -> dict[str, Any]:
    """Return every mode on the meshed skin: points (p, 3) in m, facets, frequency_hz and symmetry (k,), displacement (k, p, 3).

    M-orthonormal in scaled units. A symmetry class gives a quarter, u_z symmetric (S) or antisymmetric (A) in x, then y.
    """
    skins = [_skin(part_modes, index) for index in range(len(part_modes.rows))]
    if not skins:
        return {}
    return {
        "points": skins[0].points,
        "facets": skins[0].facets.astype(np.int32),
        "frequency_hz": np.array([row.frequency_hz for row in part_modes.rows]),
        "symmetry": np.array([row.symmetry or "" for row in part_modes.rows]),
        "displacement": np.concatenate([skin.displacement for skin in skins]),
    }


def _skin(part_modes: PartModes, index: int) -> Skin:
    row = part_modes.rows[index]
    return part_modes.model.skin(row.symmetry, part_modes.vectors[row.symmetry][:, [row.column]])


def whole_skin(part_modes: PartModes, index: int) -> Skin:
    """Return the surface of the whole body in one mode."""
    return _skin(part_modes, index).unfolded(part_modes.rows[index].symmetry)


def shapes(part_modes: PartModes, design: Design) -> dict[str, Any]:
    """Describe the modes that carry most of the target shape on the active face: target, frequency_hz, share, coefficients."""
    assert part_modes.target
    target = part_modes.target.row
    assert target
    among = part_modes.target.rows
    strongest = np.argsort(-weights(among), kind="stable")[:KEPT_MODES]
    rows = [among[i] for i in sorted(strongest, key=lambda i: among[i].frequency_hz)]
    columns = [row.column for row in rows]
    touch = part_modes.model.touch(target.symmetry, part_modes.vectors[target.symmetry][:, columns])
    coefficients = zone_coefficients(touch, design, target.symmetry)
    return {
        "target": rows.index(target),
        "frequency_hz": [row.frequency_hz for row in rows],
        "share": [1.0 if row.zone_share is None else row.zone_share for row in rows],
        "coefficients": coefficients / np.maximum(np.linalg.norm(coefficients, axis=1, keepdims=True), 1e-300),
    }


def nearest_rows(part_modes: PartModes, index: int) -> list[int]:
    """Return all modes by their distance in frequency from one of them, which comes first."""
    own = part_modes.rows[index].frequency_hz
    return sorted(range(len(part_modes.rows)), key=lambda i: abs(part_modes.rows[i].frequency_hz - own))


def closed_surface(part_modes: PartModes, case: Case, index: int) -> Any:
    """Return a pyvista PolyData in m of the whole body in one mode; `displacement` (points, 3) has unit modal mass."""
    row, skin = part_modes.rows[index], whole_skin(part_modes, index)
    thickness_m = case.design.thickness_m if part_modes.part == "plate" else None
    return _polydata(skin, thickness_m, row.frequency_hz, {"displacement": skin.displacement[0]})


def driven_surface(forced: ForcedPlate, frequency_hz: float) -> Any:
    """Return a pyvista PolyData in m of the whole plate, driven at a frequency; displacements (points, 3) in m per volt.

    `displacement` is the motion when u_z is largest anywhere, `quadrature` that a quarter period later.
    """
    skin = forced.skin(frequency_hz)
    largest, later = (over_period(skin.displacement[0], turn) for turn in (0.0, 0.25))
    parts = {"displacement": largest, "quadrature": later}
    return _polydata(skin, forced.design.thickness_m, frequency_hz, parts)


def over_period(motion: Any, turn: float) -> FloatArray:
    """Displacements (p, 3) of a complex motion, a share of the period after u_z is largest anywhere."""
    largest = motion[np.abs(motion[:, 2]).argmax(), 2]
    return np.asarray((motion * np.exp(1j * (2.0 * np.pi * turn - np.angle(largest)))).real)


def _polydata(skin: Skin, thickness_m: float | None, frequency_hz: float, fields: dict[str, FloatArray]) -> Any:
    """Return the closed surface with its fields (points, 3); thickness_m: of a plate."""
    import pyvista

    from geometry import decimation

    kept, triangles = decimation.closed_surface(skin.points, skin.facets, thickness_m)
    size = np.full((len(triangles), 1), 3)
    surface = pyvista.PolyData(np.asarray(skin.points[kept], dtype=float), np.hstack([size, triangles]).ravel())
    for name, values in fields.items():
        surface.point_data[name] = values[kept]
    if surface.n_open_edges:  # such as a clamped foot
        surface = surface.fill_holes(10.0 * surface.length)
    surface = surface.compute_normals(point_normals=False, auto_orient_normals=True)  # facets turned outwards
    surface.cell_data.clear()
    surface.field_data["frequency_hz"] = np.array([frequency_hz])
    return surface
