"""Displacements of an assembled plate at any point of its bare faces, where something may be bonded."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import make_interp_spline

from geometry.elements import FloatArray
from solvers.errors import SolverError
from solvers.superelement.cell import Cell
from solvers.superelement.plate import WHOLE, AssembledPlate, PlacedCell

SAME_M = 1e-9


def displacement_at(plate: AssembledPlate, points_m: FloatArray, back: bool) -> sp.csr_array:
    """Rows (3 p, dof) that give u at points (p, 2) in m of the back (z = thickness) or the touch face of the whole plate.

    In a symmetry class points on the negative sides follow from the mirrors. Raises SolverError for a point outside the plate
    or on a panel that carries a pillar.
    """
    flip = np.where(points_m < 0.0, -1.0, 1.0)
    folded = points_m if plate.symmetry == WHOLE else np.abs(points_m)
    rows = sp.lil_array((3 * len(points_m), plate.dof))
    left = np.ones(len(points_m), dtype=bool)
    for placed_cell in plate.placed_cells:
        inside = left & _within(placed_cell, folded)
        if not inside.any():
            continue
        left &= ~inside
        local = folded[inside] - np.array(placed_cell.middle)
        field = _on_face(placed_cell.cell, local, back)
        signs = _mirror_signs(plate.symmetry, flip[inside])
        block = signs[:, :, None] * field * placed_cell.coefficient
        live = placed_cell.coefficient != 0.0
        index = (3 * np.flatnonzero(inside)[:, None] + np.arange(3)).ravel()
        rows[np.ix_(index, placed_cell.unknown[live])] = block.reshape(len(index), -1)[:, live]
    if left.any():
        raise SolverError(f"the point {1e3 * points_m[left][0]} mm lies outside the plate")
    return sp.csr_array(rows)


def _within(placed_cell: PlacedCell, points: FloatArray) -> FloatArray:
    half = np.array(placed_cell.cell.size_m[:2]) / 2.0 + SAME_M
    return np.asarray((np.abs(points - np.array(placed_cell.middle)) <= half).all(axis=1))


def _mirror_signs(symmetry: str, flip: FloatArray) -> FloatArray:
    """Signs (p, 3) of u_x, u_y, u_z at a point from those at its image in x, y >= 0."""
    signs = np.ones((len(flip), 3))
    for axis, mark in enumerate(symmetry):
        beyond = flip[:, axis] < 0.0
        image = np.ones(3)
        image[axis] = -1.0
        signs[beyond] *= image * (1.0 if mark == "S" else -1.0)
    return signs


def _on_face(cell: Cell, local_m: FloatArray, back: bool) -> FloatArray:
    """Rows (p, 3, cell dof) from the skin's nodes on a face, a tensor grid, by splines of the mesh's own degree or less."""
    level = cell.size_m[2] if back else 0.0
    if back and cell.skin.points[:, 2].max() > cell.size_m[2] + SAME_M:
        raise SolverError("a patch lies on a panel of plate that carries a pillar: move the patch or the rows")
    on = np.flatnonzero(np.abs(cell.skin.points[:, 2] - level) < SAME_M)
    points = np.round(cell.skin.points[on, :2], 12)
    x, y = np.unique(points[:, 0]), np.unique(points[:, 1])
    place = np.searchsorted(x, points[:, 0]) * len(y) + np.searchsorted(y, points[:, 1])
    grid = np.zeros((len(x) * len(y), 3, cell.dof))
    filled = np.zeros(len(grid), dtype=bool)
    grid[place], filled[place] = cell.skin.matrix[on], True
    if not filled.all():
        raise SolverError("the face of this panel is no tensor grid: nothing can be bonded to it")
    along, across = _weights(x, local_m[:, 0]), _weights(y, local_m[:, 1])
    return np.asarray(np.einsum("pi,pj,ijcd->pcd", along, across, grid.reshape(len(x), len(y), 3, -1), optimize=True))


def _weights(nodes: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolation weights (p, n) of splines through values at the nodes, cubic where there are nodes enough."""
    spline = make_interp_spline(nodes, np.eye(len(nodes)), k=min(3, len(nodes) - 1))
    return np.asarray(spline(np.clip(at, nodes[0], nodes[-1])))
