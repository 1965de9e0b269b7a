"""A reduced cell: its matrices over boundary polynomials and fixed-interface modes, its fields, and the modes left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, eigvalsh

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.errors import SolverError
from solvers.fem import surface
from solvers.fem.assembly import Scale
from solvers.fem.solid import rigid_body_modes
from solvers.fem.surface import facet_quadrature
from solvers.superelement.interface import VERTICES, Interface
from solvers.superelement.prestress import Prestress

# -- modes left out ----------------------------------------------------------------------------------------------------
# Effect of the discarded fixed-interface modes on a cell, from their residual flexibility D (macneal1971).
# They subtract h D from the boundary's dynamic stiffness at an eigenvalue l, and l^2 <= h <= l^2 L / (L - l), L the
# lowest eigenvalue left out. A wave of the eigenvalue l and the flexibility d = u^H D u without them has m = l - h(m)
# d with them.

STEPS = 6  # of Newton: the error is squared each time
CHORD = 1e-6  # relative distance of eigenvalues below which a tangent replaces the chord
KNOWN = 0.5  # of the lowest eigenvalue left out: up to here h is known within a factor of two


@dataclass(frozen=True)
class ResidualModes:
    """The modes left out, none below the scaled eigenvalue `edge`; infinite where all are kept."""

    edge: float

    def growth(self, eigenvalue: FloatArray | float) -> FloatArray:
        """L / (L - l) at eigenvalues l (k,); infinite from L on."""
        values = np.asarray(eigenvalue, dtype=float)
        if np.isinf(self.edge):
            return np.ones_like(values)
        below = values < self.edge
        return np.where(below, self.edge / np.where(below, self.edge - values, 1.0), np.inf)

    def softening(self, eigenvalue: FloatArray | float) -> FloatArray:
        """h = l^2 (1 + L / (L - l)) / 2 at eigenvalues l (k,), the middle of its bounds; from KNOWN L on, as much as there."""
        values = np.minimum(eigenvalue, KNOWN * self.edge)
        return np.asarray(values**2 * (1.0 + self.growth(values)) / 2.0)

    def slope(self, eigenvalue: FloatArray | float) -> FloatArray:
        """dh/dl at eigenvalues l (k,)."""
        values = np.asarray(eigenvalue, dtype=float)
        below = values <= KNOWN * self.edge
        growth = self.growth(np.where(below, values, 0.0))
        return np.where(below, values * (1.0 + growth) + (values * growth) ** 2 / (2.0 * self.edge), 0.0)

    def coupled(self, eigenvalue: FloatArray, flexibility: ComplexArray) -> tuple[FloatArray, ComplexArray]:
        """Eigenvalues m (n,) of diag(l) - h(m) E, E (n, n) the flexibility, and vectors (n, n) of length 1.

        A chord through h at the eigenvalues of the two waves that an entry couples makes the problem linear in m; from KNOWN L
        on h goes on along its tangent there. The pencil's mass is positive, because the modes left out cannot move more of the
        cell's mass than there is: L E <= 1, and chords of h below KNOWN L take at most half of it.
        """
        known = self._uncoupled(eigenvalue, flexibility.diagonal().real)
        softened, apart = self.softening(known), known[:, None] - known
        alike = np.abs(apart) <= CHORD * np.maximum(*np.abs(np.broadcast_arrays(known[:, None], known)))
        slope = np.where(
            alike,
            (self.slope(known)[:, None] + self.slope(known)) / 2.0,
            (softened[:, None] - softened) / np.where(alike, 1.0, apart),
        )
        start = (softened[:, None] + softened - slope * (known[:, None] + known)) / 2.0
        values, turn = eigh(np.diag(eigenvalue) - start * flexibility, np.eye(len(known)) + slope * flexibility)
        return values, np.asarray(turn / np.linalg.norm(turn, axis=0))

    def _uncoupled(self, eigenvalue: FloatArray, own: FloatArray) -> FloatArray:
        """Roots m (n,) of m + h(m) d = l, at most KNOWN L.

        Newton's steps on a rising convex function approach its root from above and never pass it.
        """
        edge = KNOWN * self.edge
        root = np.minimum(eigenvalue, edge)
        for _ in range(STEPS):
            step = (root + self.softening(root) * own - eigenvalue) / (1.0 + self.slope(root) * own)
            root = np.minimum(root - step, edge)
        return np.asarray(root)

    def bounds(self, eigenvalue: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Between which eigenvalues waves of l (k,) and flexibilities d (k,) come to lie, (k,) each."""
        # roots of m + h d = l with the upper bound h = m^2 L / (L - m), then with the lower one h = m^2: the form of the
        # quadratic formula without cancellation
        edge, lost = self.edge, np.maximum(own, 0.0)
        root = np.sqrt((edge - eigenvalue) ** 2 + 4.0 * edge**2 * lost * eigenvalue)
        lower = 2.0 * eigenvalue * edge / (edge + eigenvalue + root)
        return np.asarray(lower), np.asarray(2.0 * eigenvalue / (1.0 + np.sqrt(1.0 + 4.0 * lost * eigenvalue)))

    def bar(self, softened: FloatArray, eigenvalue: FloatArray, own: FloatArray) -> FloatArray:
        """Relative error bars of frequencies, (k,): the distance to the bounds and the second order of the correction.

        Waves computed at m (k,) whose bounds overlap may change places: the n-th lies between the n-th lower
        and the n-th upper bound.
        """
        lower, upper = (np.sort(bound) for bound in self.bounds(eigenvalue, own))
        size = np.where(softened > 0.0, 2.0 * softened, 1.0)
        rise = np.maximum(eigenvalue - softened, 0.0) / size
        half = np.maximum(upper - softened, softened - lower) / size + rise * rise.max(initial=0.0)
        return np.where(softened > 0.0, np.maximum(half, 0.0), 0.0)


# -- cell --------------------------------------------------------------------------------------------------------------

MAX_SHARE = 0.9  # largest correction of K or M in any direction: they stay positive
RELATIVE_SHIFT = 1e-9
NULL_TOLERANCE = 1e-10  # of the mean stiffness or mass of a function: rounding
RIGID = 1e-8
# of the mass: slender stiff pillars on a soft plate follow it to 1e-8 times their stiffness over the plate's
MASS_TOLERANCE = 1e-6
DROP_TOLERANCE = 1e-14  # over sqrt(a_ii a_jj): what symmetry makes zero is left by rounding, and would fill the factor


@dataclass(frozen=True)
class Expansion:
    """Displacements at fixed points of the cell: u(points) = matrix @ degrees of freedom.

    points (p, 3) in m from the cell's middle, matrix (p, c, dof) for c components, weights (p,) in m2 of a quadrature by
    `gauss_points` of rectangles, facets (m, corners) of a surface between the points, order that of the elements whose nodes
    they are.
    """

    points: FloatArray
    matrix: FloatArray
    weights: FloatArray | None = None
    facets: IntArray | None = None
    order: int | None = None

    @classmethod
    def nothing(cls, count: int) -> Expansion:
        """A skin without facets, for the given number of degrees of freedom."""
        return cls(np.empty((0, 3)), np.empty((0, 3, count)), facets=np.empty((0, 4), dtype=np.int64))

    def rule(self, lines_m: Sequence[float] = (), cuts_m: Sequence[float] = ()) -> SurfaceRule:
        """Quadrature over the surface, parted at the lines y = const and x = const."""
        normal = self.matrix[:, -1]
        if self.weights is not None:
            points, weights, interpolation = surface.parted(self.points, self.weights, lines_m, cuts_m)
            return SurfaceRule(points, weights, normal, interpolation)
        assert self.facets is not None and self.order is not None
        rule = facet_quadrature(self.points, self.facets, self.order, lines_m, cuts_m)
        return SurfaceRule(rule.points, rule.weights, normal, rule.interpolation)

    def kept(self, keep: IntArray) -> Expansion:
        """The same from some of the degrees of freedom."""
        return replace(self, matrix=self.matrix[..., keep])


@dataclass(frozen=True)
class SurfaceRule:
    """Quadrature over a face of the cell: points (q, 3) in m from its middle, weights (q,) in m2.

    normal (n, dof): u_z at nodes; interpolation (q, n) from these to the points, None where they are the points.
    """

    points: FloatArray
    weights: FloatArray
    normal: FloatArray
    interpolation: sp.csr_array | None = None

    def values(self, vectors: FloatArray) -> FloatArray:
        """u_z at the points, (q, k), from degrees of freedom (dof, k)."""
        moved = self.normal @ vectors
        return np.asarray(moved if self.interpolation is None else self.interpolation @ moved)

    def work(self, force: FloatArray) -> FloatArray:
        """Work of forces (q,) along z at the points on each degree of freedom, (dof,)."""
        nodal = force if self.interpolation is None else self.interpolation.T @ force
        return np.asarray(nodal @ self.normal)


@dataclass(frozen=True)
class MeshError:
    """What two coarser meshes, nested in the cell's, add to K_r and M_r, (dof, dof) each, and what follows for its error.

    One mesh lacks the innermost layer at the foot's rim, the other has elements of one order less. The share `taken` of the
    first change is taken from the matrices, and uncertain by `spread`; a change by the layer comes with `edge` times as much
    by the order, the rest of which is the waves' own.
    """

    layer_stiffness: FloatArray
    layer_mass: FloatArray
    order_stiffness: FloatArray
    order_mass: FloatArray
    taken: float
    spread: float
    edge: float
    order: int = 0

    def kept(self, keep: IntArray) -> MeshError:
        """The same for some of the degrees of freedom."""
        names = ("layer_stiffness", "layer_mass", "order_stiffness", "order_mass")
        return replace(self, **{name: getattr(self, name)[np.ix_(keep, keep)] for name in names})

    def changes(self, vectors: FloatArray | ComplexArray, eigenvalue: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Relative rise of frequencies, (k,) each, on the mesh without the layer and on that of one order less.

        By Rayleigh's quotient of motions (dof, k) with eigenvalues l (k,) above 0: u^H (K - l M) u / 2 l.
        """

        def rise(stiffness: FloatArray, mass: FloatArray) -> FloatArray:
            if not stiffness.any() and not mass.any():  # of a bare panel by the layer
                return np.zeros_like(eigenvalue)
            stiff, heavy = (np.einsum("ik,ik->k", vectors.conj(), part @ vectors).real for part in (stiffness, mass))
            return np.asarray((stiff - eigenvalue * heavy) / (2.0 * eigenvalue))

        return rise(self.layer_stiffness, self.layer_mass), rise(self.order_stiffness, self.order_mass)


@dataclass(frozen=True)
class Further:
    """K_r and M_r, (m, m) each, of a cell with boundary functions of higher degrees through the thickness, up to `through`, and
    its stress fields if asked for.
    """

    through: int
    stiffness: FloatArray
    mass: FloatArray
    prestress: Prestress | None = None


@dataclass(frozen=True)
class Cell:
    """A reduced cell: K_r and M_r over [boundary degrees of freedom, fixed-interface modes], in the units of `scale`.

    size_m: edges along x, y and the plate's thickness; fixed_hz: fixed-interface frequencies kept, with their symmetry
    (modes, 2) under the cell's mirrors (0 without); touch: u_z on the touch face; skin: corners of the outer skin;
    bare: all nodes on the plate's faces that carry nothing, where something may be bonded (None unless they form a tensor
    grid); pillar_mass: the share of M_r that moves in the pillar; loss: K_r with each material's part times its loss factor;
    by_material (materials, dof, dof): the part of each in K_r; prestress: fields of thermal stress (each None unless asked
    for). grounded: whether springs hold it
    to the ground, so that it does not move freely along z. edges_m: vectors along the sides of an oblique cell, (2, 2), whose
    lengths size_m has then; None for a rectangle.

    No fixed-interface mode below dropped_hz was left out. `dropped` (boundary, boundary) is the residual flexibility of those
    left out (`ResidualModes`): (M Psi)' K_II^-1 (M Psi) less the same of the modes kept.
    """

    stiffness: FloatArray
    mass: FloatArray
    pillar_mass: FloatArray
    interface: Interface
    scale: Scale
    size_m: tuple[float, float, float]
    fixed_hz: FloatArray
    fixed_parity: IntArray
    dropped_hz: float
    dropped: FloatArray
    touch: Expansion
    skin: Expansion
    mesh_dof: int
    mesh_error: MeshError | None = None
    bare: Expansion | None = None
    further: Further | None = None
    loss: FloatArray | None = None
    by_material: FloatArray | None = None
    grounded: bool = False
    edges_m: FloatArray | None = None
    prestress: Prestress | None = None

    @property
    def vectors_m(self) -> FloatArray:
        """Vectors along the sides, (2, 2), m: those by which the cell repeats."""
        return np.diag(self.size_m[:2]) if self.edges_m is None else self.edges_m

    @property
    def dof(self) -> int:
        """Degrees of freedom of the reduced cell."""
        return len(self.stiffness)

    @property
    def residual(self) -> ResidualModes:
        """The fixed-interface modes left out."""
        return ResidualModes(self.scale.eigenvalue(self.dropped_hz))

    def on_boundary(self, matrix: FloatArray) -> FloatArray:
        """A matrix (boundary, boundary) among all degrees of freedom, (dof, dof)."""
        out = np.zeros_like(self.mass)
        out[: len(matrix), : len(matrix)] = matrix
        return out


def restricted(cell: Cell, face: Interface, top_hz: float = inf) -> Cell:
    """Restrict a cell to the boundary functions of a lower interface and to fixed-interface modes up to a frequency.

    Constraint modes are computed one by one, so a part of the matrices is what such a reduction would give.

    Parameters
    ----------
    cell : Cell
        Reduced with at least the functions and modes that remain.
    face : Interface
        Degrees of the boundary functions that remain.
    top_hz : float, optional
        Highest fixed-interface frequency that remains, Hz; by default all remain.

    Returns
    -------
    Cell
        The restricted cell, whose `further` keeps K_r and M_r of all functions and modes.
    """
    count, own, within = cell.interface.count, cell.interface.within(face), cell.fixed_hz <= top_hz
    left, keep = count + np.flatnonzero(~within), np.concatenate([own, count + np.flatnonzero(within)])
    pushed, square = cell.mass[:count, left], np.ix_(keep, keep)
    # a mode phi of eigenvalue l adds (phi' M Psi)' (phi' M Psi) / l to the residual flexibility once it is discarded
    dropped = cell.dropped + (pushed / np.diag(cell.stiffness)[left]) @ pushed.T
    names = ("stiffness", "mass", "pillar_mass", "loss")
    matrices = {name: part[square] for name in names if (part := getattr(cell, name)) is not None}
    if cell.by_material is not None:
        matrices["by_material"] = cell.by_material[:, keep[:, None], keep]
    fields = {name: each and each.kept(keep) for name in ("touch", "skin", "bare") if (each := getattr(cell, name))}
    return replace(
        cell,
        **matrices,
        **fields,
        interface=face,
        fixed_hz=cell.fixed_hz[within],
        fixed_parity=cell.fixed_parity[within],
        dropped_hz=float(cell.fixed_hz[~within].min(initial=cell.dropped_hz)),
        dropped=dropped[np.ix_(own, own)],
        mesh_error=cell.mesh_error and cell.mesh_error.kept(keep),
        further=Further(cell.interface.through, cell.stiffness, cell.mass, cell.prestress),
        prestress=cell.prestress and cell.prestress.kept(keep),
    )


def with_further(cell: Cell) -> Cell:
    """Return the cell with its further boundary functions among the others; its fields at points do not include them.

    Parameters
    ----------
    cell : Cell
        Restricted in the degree through the thickness alone: `further` has its modes and degree along the sides.

    Returns
    -------
    Cell
        Cell with the larger K_r and M_r and the interface of their degree, without an error estimate of its mesh.
    """
    assert cell.further
    face, further = replace(cell.interface, through=cell.further.through), cell.further
    larger = replace(cell, interface=face, stiffness=further.stiffness, mass=further.mass, prestress=further.prestress)
    return replace(larger, mesh_error=None, further=None, loss=None, by_material=None)


def places_of(bases: Sequence[FloatArray], modes: Sequence[int]) -> list[FloatArray]:
    """Map each symmetry class's degrees of freedom to the cell's.

    Parameters
    ----------
    bases : sequence of ndarray, shape (boundary, b)
        Boundary basis of each class in the cell's boundary degrees of freedom.
    modes : sequence of int
        Number of fixed-interface modes of each class.

    Returns
    -------
    list of ndarray, shape (dof, b + modes)
        One matrix per class; the cell's degrees of freedom are its boundary's, then the modes of each class in turn.
    """
    start, places, count = len(bases[0]), [], len(bases[0]) + sum(modes)
    for basis, own in zip(bases, modes, strict=True):
        place = np.zeros((count, basis.shape[1] + own))
        place[: len(basis), : basis.shape[1]] = basis
        place[start : start + own, basis.shape[1] :] = np.eye(own)
        places.append(place)
        start += own
    return places


def mirrored(
    points: FloatArray, fields: Sequence[FloatArray], signs: Sequence[Mapping[int, int]], axes: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Expand the fields of a cell's symmetry classes at points of the meshed part to every mirror image.

    Parameters
    ----------
    points : ndarray, shape (p, 3)
        Points of the meshed part; the mirror planes pass through the origin.
    fields : sequence of ndarray, shape (p, 3 or 1, dof)
        Displacement, or u_z alone, at the points from the cell's degrees of freedom: the part of each class.
    signs : sequence of mapping
        Parity of u_z (1 or -1) of each class under the mirror of each axis.
    axes : sequence of int
        Normals of the mirror planes: 0 for x, 1 for y.

    Returns
    -------
    points : ndarray, shape (copies p, 3)
        Points of the meshed part, then those of its images.
    matrix : ndarray, shape (copies p, 3 or 1, dof)
        Field of all classes together at these points.
    """
    copies, flips = 2 ** len(axes), np.ones((2 ** len(axes), 3))
    flips[:, list(axes)] = list(product((1, -1), repeat=len(axes)))
    matrix = np.zeros((copies, *fields[0].shape))
    for total, flip in zip(matrix, flips, strict=True):
        for field, own in zip(fields, signs, strict=True):
            total += np.prod([own[axis] for axis in axes if flip[axis] < 0]) * field
        if matrix.shape[2] == 3:
            total *= flip[:, None]
    return (points * flips[:, None]).reshape(-1, 3), matrix.reshape(-1, *matrix.shape[2:])


def check_rigid(cell: Cell, whole: FloatArray | float, stressed: bool = False) -> None:
    """Check that rigid-body modes carry no stiffness and that translations carry the whole mass.

    Parameters
    ----------
    cell : Cell
        The reduced cell.
    whole : ndarray, shape (3,), or float
        Mass of the full mesh that moves along each axis, scaled.
    stressed : bool, optional
        Whether K_r has a stress at rest, which turns with the cell: a rotation then meets forces, but they do no work.

    Raises
    ------
    SolverError
        If a rigid-body mode meets a force, or the reduced mass differs.
    """
    motions = rigid_boundary(cell)
    forces = cell.stiffness @ motions
    met = np.append(forces[:, :3], motions.T @ forces if stressed else forces[:, 3:])
    force = np.abs(met).max() / np.abs(cell.stiffness).max()
    if force > RIGID:
        raise SolverError(f"a rigid-body mode of the reduced cell meets a force of {force:.1e} of its stiffness")
    masses = np.diag(motions[:, :3].T @ cell.mass @ motions[:, :3])
    if np.abs(masses / whole - 1.0).max() > MASS_TOLERANCE:
        raise SolverError(f"the reduced cell carries {masses / whole} of its mass")


def rigid_boundary(cell: Cell) -> FloatArray:
    """Return the six rigid-body modes in the cell's degrees of freedom; exact, because they are linear in x, y, z.

    Parameters
    ----------
    cell : Cell
        The reduced cell.

    Returns
    -------
    ndarray, shape (dof, 6)
        Unit translations along x, y, z, then rotations about these axes; zero in the fixed-interface modes.
    """
    out = np.zeros((cell.dof, 6))
    out[: cell.interface.count] = rigid_polynomials(cell.interface, cell.size_m, cell.edges_m)
    return out


def rigid_polynomials(
    face: Interface, size_m: tuple[float, float, float], edges_m: FloatArray | None = None
) -> FloatArray:
    """Return the rigid-body modes of a cell among its boundary functions.

    Parameters
    ----------
    face : Interface
        Degrees of the boundary functions.
    size_m : tuple of float
        Edges along x and y and the thickness; their ratios alone matter.
    edges_m : ndarray, shape (2, 2), optional
        Vectors along the sides of an oblique cell.

    Returns
    -------
    ndarray, shape (count, 6)
        Unit translations along x, y, z, then rotations about the middle that move the longest edge's ends by 1.
    """
    corners = np.array([[*corner, z] for corner in VERTICES for z in (-1, 1)], dtype=float)
    plan = corners[:, :2] * np.array(size_m[:2]) if edges_m is None else corners[:, :2] @ edges_m
    points = np.column_stack([plan, corners[:, 2] * size_m[2]]) / 2.0
    motions = rigid_body_modes(points, np.zeros(3), max(size_m) / 2.0).reshape(4, 2, 3, 6)
    out = np.zeros((face.count, 6))
    for vertex in range(4):
        block = np.zeros((face.layers, 3, 6))
        block[0] = motions[vertex].mean(axis=0)
        block[1] = (motions[vertex, 1] - motions[vertex, 0]) / 2.0
        out[face.vertex(vertex)] = block.reshape(-1, 6)
    return out


@dataclass(frozen=True)
class PlacedCell:
    """A cell in the plate: which reduction, its middle (m), its degrees of freedom among the reduced plate's, their
    coefficients, and at a clamped edge, which is singular, the share of the last order's change that is taken from the cell.
    """

    cell: Cell
    middle: tuple[float, float]
    dofs: IntArray
    coefficient: FloatArray
    copies: int
    softened: float | None = None


def metrics(cell: Cell) -> tuple[FloatArray, FloatArray]:
    """Return metrics of the changes of K and M: M, and K plus a small multiple of M, which gives rigid-body modes stiffness.

    Parameters
    ----------
    cell : Cell
        Reduced cell.

    Returns
    -------
    tuple of ndarray, shape (dof, dof)
        Positive definite but for functions of free sides.
    """
    slight = RELATIVE_SHIFT * cell.stiffness.trace() / cell.mass.trace()
    return cell.stiffness + slight * cell.mass, cell.mass


def largest(change: FloatArray, metric: FloatArray) -> float:
    """Compute the largest eigenvalue of a change relative to a metric, over the functions that carry something.

    Functions of free sides carry nothing, nor do those that a coarse mesh of tetrahedra cannot distinguish from others.

    Parameters
    ----------
    change, metric : ndarray, shape (n, n)
        Symmetric.

    Returns
    -------
    float
        Dimensionless, at least MAX_SHARE.
    """
    nonzero = np.flatnonzero(np.diag(metric) > 0.0)
    square, unit = np.ix_(nonzero, nonzero), np.sqrt(np.diag(metric)[nonzero])
    values, turn = eigh(metric[square] / np.outer(unit, unit))
    kept = values > NULL_TOLERANCE
    turn = turn[:, kept] / np.sqrt(values[kept]) / unit[:, None]
    return max(MAX_SHARE, float(eigvalsh(turn.T @ change[square] @ turn)[-1]))
