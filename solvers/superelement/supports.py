"""Supports of an assembled plate: what they hold, and their stiffness, damping and mass in its degrees of freedom.

An edge's boundary functions are polynomials along the edge and through the thickness, so a clamp drops them and a foam adds
their Gram matrix. On a disc u is interpolated between the nodes of the panels that it meets. Both are sums over points,
K_s = k sum_q w_q b_q' b_q, b_q the row of u_z at a point and the weights w_q 1 over the whole plate.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import pi

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular

from geometry.elements import FloatArray, IntArray
from geometry.supports import Support
from geometry.tiling import Tiling
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.solid import rigid_body_modes
from solvers.fem.surface import grid_weights
from solvers.superelement.cell import DROP_TOLERANCE, Cell, PlacedCell

AXES = "xyz"
REACH = 2  # panels about a disc that keep all boundary functions
RINGS, SPOKES = 6, 24  # points of a disc: exact for polynomials of degree 11 and for harmonics below 24
RANK = 1e-9  # of the largest singular value of what the supports hold
# rigid-body modes of the symmetry classes of u_z, x then y: translations x, y, z, rotations about x, y, z
RIGID_OF_CLASS = {"SS": (2,), "SA": (1, 3), "AS": (0, 4), "AA": (5,)}


@dataclass(frozen=True)
class Action:
    """What a support does in one class of a plate: rows of u at its points, (q, dof) for each axis, and their weights (q,)."""

    support: Support
    length_m: float
    weights: FloatArray
    rows: tuple[sp.csr_array, sp.csr_array, sp.csr_array]

    def gram(self, axis: int) -> sp.csc_array:
        """Sum of w_q b_q' b_q, (dof, dof)."""
        own = self.rows[axis]
        full = sp.coo_array(own.T @ sp.diags_array(self.weights) @ own)
        size = np.sqrt(full.diagonal())
        # what orthogonal functions leave by rounding would be another pattern than the cells'
        kept = np.abs(full.data) > DROP_TOLERANCE * size[full.row] * size[full.col]
        return sp.csc_array((full.data[kept], (full.row[kept], full.col[kept])), shape=full.shape)

    def stiffness(self, scale: Scale) -> sp.csc_array:
        """Scaled stiffness along z, (dof, dof)."""
        return sp.csc_array(_scaled(self.support, self.length_m, scale)[0] * self.gram(2))

    def mass(self, scale: Scale) -> sp.csc_array:
        """Scaled mass along all axes, (dof, dof)."""
        weight = _scaled(self.support, self.length_m, scale)[1]
        return sp.csc_array(weight * sum(self.gram(axis) for axis in range(3)))

    def force(self, scale: Scale, eigenvalue: FloatArray) -> FloatArray:
        """Scaled force along z over the motion at scaled eigenvalues l, k - l m, (n,)."""
        stiffness, mass = _scaled(self.support, self.length_m, scale)
        return np.asarray(stiffness - eigenvalue * mass)

    def damping(self, scale: Scale, vectors: FloatArray) -> FloatArray:
        """Scaled damping between motions (dof, k) along z, (k, k): i w C next to K - w2 M, w and C scaled, too."""
        moved = self.rows[2] @ vectors
        unit = scale.mass_kg * scale.angular
        return np.asarray(self.support.damping_n_s_m / unit * (moved.T @ (self.weights[:, None] * moved)))


@dataclass(frozen=True)
class Hold:
    """What a plate feels of a disc that is held: stiffness (n, n) in the degrees of freedom `dofs` (n,) of its grid, scaled.

    layer: what a mesh without the innermost layer at the rim adds to it; missed: how much of that, at most, the finest mesh has
    too much; count: of mirror images, itself included. material: number of the plate's material there among those of its
    cells; loss_factor: of that one.
    """

    dofs: IntArray
    stiffness: FloatArray
    layer: FloatArray
    missed: float
    count: int
    material: int = 0
    loss_factor: float = 0.0


Placed = Sequence[tuple[tuple[int, int], PlacedCell]]  # cells of a plate with column and row of their panels


def actions(tiling: Tiling, placed: Placed, dof: int) -> list[Action]:
    """Find what the supports of a plate do in its degrees of freedom, apart from holding edges.

    Parameters
    ----------
    tiling : Tiling
        Panels and supports of the plate.
    placed : sequence of tuple
        Column and row of each panel that is assembled, with its cell.
    dof : int
        Number of degrees of freedom of the symmetry class, or of the whole plate.

    Returns
    -------
    list of Action
        One for each support with a stiffness, a damping or a mass.

    Raises
    ------
    SolverError
        For a disc on a panel whose face cannot be interpolated.
    """
    return [
        _action(tiling, placed, dof, each)
        for each in tiling.supports
        if each.stiffness_n_m or each.bedding_n_m2 or each.damping_n_s_m or each.mass_kg
    ]


def softness(tiling: Tiling, placed: Placed, scale: Scale, value: float) -> tuple[float, float]:
    """Bound what springs and masses add to a plate's K and M: E <= t (K + l M), F <= f (M + K / l).

    Each panel bears its own part of E and F alone, so that the worst panel bounds them all.

    Parameters
    ----------
    tiling : Tiling
        Panels and supports of the plate.
    placed : sequence of tuple
        Column and row of each panel that is assembled, with its cell.
    scale : Scale
        Units of the cells.
    value : float
        l, scaled.

    Returns
    -------
    t, f : float
        Dimensionless; infinite for a panel whose K + l M is not positive.
    """
    total = np.zeros(2)
    for support in tiling.supports:
        length, worst = _length_m(tiling, support), np.zeros(2)
        for each, weights, rows in _parts(tiling, placed, support):
            live = np.flatnonzero(each.coefficient[: rows.shape[2]] != 0.0)
            inside = np.flatnonzero(each.coefficient != 0.0)
            try:
                lower = np.linalg.cholesky((each.cell.stiffness + value * each.cell.mass)[np.ix_(inside, inside)])
            except np.linalg.LinAlgError:
                return np.inf, np.inf
            motion = np.zeros((len(inside), *rows.shape[:2]))
            motion[: len(live)] = (np.sqrt(weights)[:, None, None] * rows[:, :, live]).transpose(2, 0, 1)
            answer = solve_triangular(lower, motion.reshape(len(inside), -1), lower=True).reshape(motion.shape)
            share = [np.linalg.norm(part.reshape(len(inside), -1), 2) ** 2 for part in (answer[..., 2], answer)]
            worst = np.maximum(worst, share)
        stiffness, mass = _scaled(support, length, scale)
        total += worst * (stiffness, value * mass)
    return float(total[0]), float(total[1])


def _scaled(support: Support, length_m: float, scale: Scale) -> tuple[float, float]:
    """Scaled stiffness along z and mass of a support."""
    return support.stiffness_of(length_m) / (scale.young_pa * scale.length_m), support.mass_kg / scale.mass_kg


def _length_m(tiling: Tiling, support: Support) -> float:
    """Length of the edge that a support is on."""
    lines = tiling.y if support.edge[:1] == "x" else tiling.x
    return float(lines[-1] - lines[0])


def _parts(tiling: Tiling, placed: Placed, support: Support) -> Iterator[tuple[PlacedCell, FloatArray, FloatArray]]:
    """Panels that a support meets, with the weights (q,) of its points on one of them and u (q, 3, n) there."""
    length = _length_m(tiling, support)
    for place, each in placed:
        found = (
            _on_edge(tiling, place, each, support, length) if support.edge else _on_disc(tiling, place, each, support)
        )
        if found is not None:
            yield each, *found


def _action(tiling: Tiling, placed: Placed, dof: int, support: Support) -> Action:
    parts = list(_parts(tiling, placed, support))
    weights = [np.empty(0), *(each.copies * own for each, own, _ in parts)]
    rows = tuple(_stacked([(each, part[:, axis]) for each, _, part in parts], dof) for axis in range(3))
    return Action(support, _length_m(tiling, support), np.concatenate(weights), (rows[0], rows[1], rows[2]))


def _stacked(entries: Sequence[tuple[PlacedCell, FloatArray]], dof: int) -> sp.csr_array:
    """Rows (q, cell dof) of several cells in the plate's degrees of freedom."""
    parts = [sp.csr_array((0, dof))]
    for placed, rows in entries:
        live = np.flatnonzero((placed.coefficient[: rows.shape[1]] != 0.0) & (rows != 0.0).any(axis=0))
        place = sp.csr_array(
            (placed.coefficient[live], (np.arange(len(live)), placed.dofs[live])), shape=(len(live), dof)
        )
        parts.append(sp.csr_array(rows[:, live]) @ place)
    return sp.csr_array(sp.vstack(parts, format="csr"))


def at_edge(tiling: Tiling, i: int, j: int, edge: str) -> bool:
    """Whether a panel lies at an edge of the plate.

    Parameters
    ----------
    tiling : Tiling
        The plate's panels.
    i, j : int
        Column and row of the panel.
    edge : str
        x-, x+, y- or y+.

    Returns
    -------
    bool
        True at the edge.
    """
    number, last = (i, len(tiling.x) - 2) if edge[0] == "x" else (j, len(tiling.y) - 2)
    return number == (0 if edge[1] == "-" else last)


def full_panels(tiling: Tiling) -> set[tuple[int, int]]:
    """List the panels that keep all boundary functions: those with a foot, at a supported edge or about a support.

    Parameters
    ----------
    tiling : Tiling
        The plate's panels.

    Returns
    -------
    set of tuple
        Column and row of each.
    """
    nx, ny = len(tiling.x) - 1, len(tiling.y) - 1
    full, places = set(tiling.feet), [(i, j) for i in range(nx) for j in range(ny)]
    for support in tiling.supports:
        if support.edge:
            full |= {place for place in places if at_edge(tiling, *place, support.edge)}
            continue
        x0, x1, y0, y1 = support.box_m
        columns, rows = (
            np.searchsorted(lines, ends) - 1 for lines, ends in ((tiling.x, [x0, x1]), (tiling.y, [y0, y1]))
        )
        full |= {
            (i, j)
            for i, j in places
            if columns[0] - REACH <= i <= columns[1] + REACH and rows[0] - REACH <= j <= rows[1] + REACH
        }
    return full


def _on_edge(
    tiling: Tiling, place: tuple[int, int], placed: PlacedCell, support: Support, length_m: float
) -> tuple[FloatArray, FloatArray] | None:
    """Weights (q,) and u (q, 3, boundary) at points of a panel's side, None for a panel elsewhere."""
    if not at_edge(tiling, *place, support.edge):
        return None
    face, across = placed.cell.interface, 1 - "xy".index(support.edge[0])
    s, along = np.polynomial.legendre.leggauss(face.along + 1)
    layers = [np.polynomial.legendre.leggauss(face.through + 1)] * (len(face.joints) + 1)
    ends = list(pairwise((-1.0, *face.joints, 1.0)))
    z = np.concatenate(
        [(low + high + (high - low) * own[0]) / 2.0 for (low, high), own in zip(ends, layers, strict=True)]
    )
    through = np.concatenate([(high - low) * own[1] / 2.0 for (low, high), own in zip(ends, layers, strict=True)])
    points = np.zeros((len(s), len(z), 3))
    points[..., across], points[..., 2] = s[:, None], z
    points[..., 1 - across] = 1.0 if support.edge[1] == "+" else -1.0
    values = face.evaluate(points.reshape(-1, 3))
    rows = np.zeros((len(values), 3, face.count))
    for axis in range(3):
        rows[:, axis, axis::3] = values
    share = placed.cell.size_m[across] / length_m
    return share * np.outer(along, through).ravel() / 4.0, rows


def _on_disc(
    tiling: Tiling, place: tuple[int, int], placed: PlacedCell, support: Support
) -> tuple[FloatArray, FloatArray] | None:
    """Weights (q,) and u (q, 3, cell dof) at the points of a disc on a panel, None where it has none."""
    points, weights = disc_points(support)
    column, row = (np.searchsorted(line, points[:, axis]) - 1 for axis, line in enumerate((tiling.x, tiling.y)))
    inside = (column == place[0]) & (row == place[1])
    if not inside.any():
        return None
    return weights[inside], _back_field(placed.cell, points[inside] - np.array(placed.middle))


def disc_points(support: Support) -> tuple[FloatArray, FloatArray]:
    """Place the points of a disc's quadrature.

    Parameters
    ----------
    support : Support
        On a disc.

    Returns
    -------
    points : ndarray, shape (q, 2)
        In m; on none of the mirror lines of a disc in the plate's middle.
    weights : ndarray, shape (q,)
        Their sum is 1.
    """
    s, own = np.polynomial.legendre.leggauss(RINGS)
    rings = np.sqrt((1.0 + s) / 2.0) * support.radius_m
    angles = 2.0 * pi * (np.arange(SPOKES) + 0.5) / SPOKES
    ring = np.stack([np.outer(rings, np.cos(angles)), np.outer(rings, np.sin(angles))], axis=-1)
    return ring.reshape(-1, 2) + np.array(support.at_m), np.repeat(own / 2.0 / SPOKES, SPOKES)


def _back_field(cell: Cell, places_m: FloatArray) -> FloatArray:
    """u at places (q, 2) of the back face from the cell's degrees of freedom, (q, 3, dof)."""
    bare = cell.bare
    on = np.empty(0, dtype=np.int64)
    if bare is not None:
        on = np.flatnonzero(np.abs(bare.points[:, 2] - cell.size_m[2]) < 1e-6 * cell.size_m[2])
    if bare is None or bare.order is None or not len(on):
        raise SolverError("a support lies on a panel of plate that carries a pillar: move the support or the rows")
    field = np.tensordot(grid_weights(bare.points[on, :2], bare.order, places_m), bare.matrix[on], axes=1)
    if field.shape[2] == cell.dof:
        return np.asarray(field)
    face = cell.interface  # further functions through the thickness, whose fields at points are not known
    known = np.flatnonzero(face.across < face.layers - (cell.dof - field.shape[2]) * face.layers // face.count)
    wide = np.zeros((*field.shape[:2], cell.dof))
    wide[..., np.concatenate([known, np.arange(face.count, cell.dof)])] = field
    return wide


def held_dofs(tiling: Tiling, corners: IntArray, beside_x: IntArray, beside_y: IntArray) -> Iterator[IntArray]:
    """List the degrees of freedom that supports hold at rest.

    Parameters
    ----------
    tiling : Tiling
        The plate with its supports.
    corners : ndarray of int, shape (nx + 1, ny + 1, m)
        Degrees of freedom of the vertex lines, component fastest.
    beside_x : ndarray of int, shape (nx + 1, ny, n)
        Those of the sides on lines x = const.
    beside_y : ndarray of int, shape (nx, ny + 1, n)
        Those of the sides on lines y = const.

    Yields
    ------
    ndarray of int, shape (n,)
        Degrees of freedom.
    """
    for support in (each for each in tiling.supports if each.edge):
        end = 0 if support.edge[1:] == "-" else -1
        for axis in support.held_axes:
            for dofs in (
                (corners[end], beside_x[end]) if support.edge[0] == "x" else (corners[:, end], beside_y[:, end])
            ):
                yield dofs[..., AXES.index(axis) :: 3].ravel()


def rigid_count(tiling: Tiling, thickness_m: float, symmetry: str = "") -> int:
    """Count the rigid-body modes that supports leave.

    Parameters
    ----------
    tiling : Tiling
        The plate with its supports.
    thickness_m : float
        Thickness of the plate in m.
    symmetry : str, optional
        Class of u_z, x then y; all of them by default.

    Returns
    -------
    int
        From 0 to 6: their number less the rank of what resists them.
    """
    own = RIGID_OF_CLASS.get(symmetry, range(6))
    rows = [part[:, own] for part in (_resisted(tiling, thickness_m, each) for each in tiling.supports) if len(part)]
    if not rows:
        return len(own)
    singular = np.linalg.svd(np.vstack(rows), compute_uv=False)
    return int(len(own) - (singular > RANK).sum())


def _resisted(tiling: Tiling, thickness_m: float, support: Support) -> FloatArray:
    """Rows of the rigid-body modes that a support holds or springs resist, (n, 6)."""
    x, y = tiling.x[[0, -1]], tiling.y[[0, -1]]
    points = disc_points(support)[0]
    axes = support.held_axes or ("z" if support.stiffness_n_m or support.bedding_n_m2 else "")
    if support.edge:
        end = 0 if support.edge[1] == "-" else 1
        points = np.array([[x[end], v] for v in y] if support.edge[0] == "x" else [[v, y[end]] for v in x])
    levels = [0.0, thickness_m] if support.edge else [thickness_m]
    nodes = np.array([[*point, level] for point in points for level in levels])
    motions = rigid_body_modes(nodes, np.array([0.0, 0.0, thickness_m / 2.0]), float(max(x[1], y[1])))
    return np.asarray(motions[:, [AXES.index(axis) for axis in axes]].reshape(-1, 6))
