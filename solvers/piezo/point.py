"""Response of a patched plate at points of its touch face, as a laser vibrometer sees it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geometry.elements import ComplexArray, FloatArray
from solvers.piezo.bond import Contact, displacement_at
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.piezo.patched_plate import Group


def point_response(forced: ForcedPlate, point_m: tuple[float, float], frequency_hz: FloatArray) -> ComplexArray:
    """u_z per volt of drive, (n,) in m/V, at the quadrature point of the touch face nearest to a point in m."""
    return point_responses(forced, np.array([point_m]), frequency_hz)[0]


def point_responses(forced: ForcedPlate, points_m: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """The same at points (p, 2): (p, n) in m/V."""
    rows = [_rows(basis, points_m) for basis in forced.modes]
    out = np.zeros((len(points_m), len(frequency_hz)), dtype=complex)
    for index, frequency in enumerate(frequency_hz):
        eigenvalue = forced.plate.scale.eigenvalue(float(frequency))
        volts = forced.volts(eigenvalue)
        for basis, row in zip(forced.modes, rows, strict=True):
            out[:, index] += row @ basis.amplitudes(eigenvalue, forced.loss, volts)
    return out


def loudest_point(forced: ForcedPlate, frequency_hz: float, half_width_m: float) -> tuple[float, float]:
    """Where |u_z| of the operating shape is largest on |y| < half_width_m, (x, y) in m; the first of equals from x, y >= 0."""
    points, values = forced.shape(frequency_hz)
    size = np.where(np.abs(points[:, 1]) < half_width_m, np.abs(values), 0.0)
    equal = np.flatnonzero(size >= (1.0 - 1e-6) * size.max())
    best = equal[np.lexsort((points[equal, 0], points[equal].min(axis=1) < 0.0))[0]]
    return float(points[best, 0]), float(points[best, 1])


def _rows(basis: GroupModes, points_m: FloatArray) -> FloatArray:
    """u_z at the points per unit of each column, (points, columns): the symmetry classes of the group added up."""
    total = np.zeros((len(points_m), basis.columns.shape[1]))
    for symmetry, field in zip(basis.group.symmetries, basis.group.touch(basis.columns), strict=True):
        folded, sign = np.array(points_m), np.ones(len(points_m))
        for axis, mark in enumerate(symmetry):
            below = folded[:, axis] < 0.0
            folded[below, axis] *= -1.0
            sign[below] *= 1.0 if mark == "S" else -1.0
        nearest = [int(np.argmin(((field.points - point) ** 2).sum(axis=1))) for point in folded]
        total += sign[:, None] * field.values[nearest]
    return total


def face_motion(group: Group, points_m: FloatArray, axis: int = 2, means: FloatArray | None = None) -> sp.csr_array:
    """Rows (points, dof) that give u along an axis (default: u_z) of a group at points (q, 2) in m of the touch face.

    means: weights (b, q) of sums over the points, which the rows (b, dof) then give.
    """
    contact = Contact(points_m, np.eye(len(points_m)) if means is None else means, back=False)
    parts = [displacement_at(plate, contact)[axis::3] for plate in group.plates]
    return sp.csr_array(sp.hstack(parts, format="csr"))
