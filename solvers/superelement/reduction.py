"""Craig-Bampton reduction of one finely meshed panel of plate to boundary polynomials and fixed-interface modes.

V = [constraint shapes K_II Psi = -K_IB P, fixed-interface modes of (K_II, M_II)]; K_r = V'KV, M_r = V'MV
(craig1968, castanier2001). Frequencies converge from above in the degrees and in the number of modes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import product

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.mesh import AnyMesh
from solvers.errors import SolverError
from solvers.fem.assembly import System, on_components
from solvers.fem.eigen import PlainPencil, Shared, lowest_hz, modes_in_band
from solvers.fem.factor import Factor, Factoriser, parallel_map
from solvers.fem.prestress import StressFields
from solvers.fem.solid import constrain, free_mask, rigid_body_modes
from solvers.fem.surface import skin_faces
from solvers.superelement.cell import Cell, Expansion, check_rigid, mirrored, places_of, rigid_polynomials
from solvers.superelement.interface import SIDES, Interface
from solvers.superelement.prestress import Prestress, joined
from solvers.superelement.symmetry import DiagonalSector, diagonal_mirror
from solvers.threads import one_thread

SAME = 1e-6  # of the thickness: one place
AT_ONCE = 96  # shapes whose fields are held twice

Coarser = Callable[
    [Cell, "CellBuilder", "list[SymmetryClass]"], Cell
]  # corrects the discretisation error by a coarser mesh


def reduce_cell(
    system: System,
    interface: Interface,
    top_hz: float,
    halved: tuple[int, ...] = (),
    free: tuple[str, ...] = (),
    coarser: Coarser | None = None,
    edges_m: FloatArray | None = None,
    fields: StressFields | None = None,
) -> Cell:
    """Reduce a panel to boundary functions and fixed-interface modes.

    Parameters
    ----------
    system : System
        Assembled matrices of a mesh with its middle at the origin.
    interface : Interface
        Degrees of the boundary functions.
    top_hz : float
        Highest fixed-interface frequency to keep, Hz.
    halved : tuple of int
        Axes meshed on their positive side only.
    free : tuple of str
        Sides that join nothing: they move as the mesh lets them, and their bubbles carry nothing.
    coarser : callable, optional
        Corrects the discretisation error.
    edges_m : ndarray, shape (2, 2), optional
        Vectors along the sides of an oblique cell, which is not halved; by default its sides lie along x and y.
    fields : StressFields, optional
        Fields of thermal stress, which the cell then has, too.

    Returns
    -------
    Cell
        The reduced cell, in the units of the system's scale.

    Raises
    ------
    SolverError
        If a rigid-body mode meets a force or the mass is wrong.
    """
    _enough_nodes(system, interface)
    with one_thread():  # blocks of eight columns: a second thread mostly waits, and another case can use its core
        build = CellBuilder(system, interface, halved, free, edges_m)
        build.fields = fields
        parts = build.classes(top_hz)
        cell = build.join(parts)
    build.check(cell)
    return coarser(cell, build, parts) if coarser else cell


def _enough_nodes(system: System, interface: Interface) -> None:
    """Raise SolverError if the mesh has fewer nodes through the plate than the boundary functions need."""
    mesh = system.mesh
    side = mesh.nodes[mesh.nodes_of("x+")]
    through = len(np.unique(np.round(side[:, 2] / np.ptp(side[:, 2]), 9)))
    if mesh.kind == "hex" and through < interface.layers:
        raise SolverError(
            f"degree {interface.through} through the thickness needs {interface.layers} nodes, the mesh has {through}: "
            "use a higher order or more elements through the plate"
        )


@dataclass(frozen=True)
class SymmetryClass:
    """One symmetry class: its basis of boundary degrees of freedom, nodal shapes (3n, m) and fixed-interface frequencies.

    No fixed-interface mode of the class below dropped_hz is discarded; flexibility (boundary, boundary) is the residual
    flexibility of the discarded ones, (M Psi)' K_II^-1 (M Psi) less the same of the modes kept.
    """

    signs: dict[int, int]
    basis: FloatArray
    shapes: FloatArray
    fixed_hz: FloatArray
    dropped_hz: float
    flexibility: FloatArray
    turned: SymmetryClass | None = None  # the class that this one is, turned over: its matrices are the same


class ClassSector:
    """All fields of one symmetry class whose free degrees of freedom are `inside` (n, 3), with their K and M."""

    def __init__(self, system: System, inside: BoolArray) -> None:
        self.keep = np.flatnonzero(inside.ravel())
        self.pencil = constrain(system, inside)

    def spread(self, vectors: FloatArray) -> FloatArray:
        """Fields at every node, (3n, k)."""
        return self.pencil.expand(vectors).reshape(self.pencil.free.size, -1)

    def restrict(self, field: FloatArray) -> FloatArray:
        """Restrict nodal loads (3n, k) to the free degrees of freedom."""
        return np.asarray(field[self.keep])


Sector = ClassSector | DiagonalSector


@dataclass(frozen=True)
class ClampedBoundaryClass:
    """One symmetry class, or half of it, with its boundary clamped: boundary basis, constraint shapes (3n, m), K_II^-1."""

    basis: FloatArray
    shapes: FloatArray
    sector: Sector
    factorise: Factoriser
    factor: Factor


class CellBuilder:
    """Reduces the symmetry classes of one piece and joins them."""

    def __init__(
        self,
        system: System,
        interface: Interface,
        halved: tuple[int, ...],
        free: tuple[str, ...],
        edges_m: FloatArray | None = None,
    ) -> None:
        mesh = system.mesh
        self.system, self.interface, self.halved, self.edges_m = system, interface, halved, edges_m
        self.copies = 2 ** len(halved)
        if edges_m is None:  # a pillar's tip may overhang the plate
            self.half = np.abs(mesh.nodes[mesh.nodes_of("touch"), :2]).max(axis=0)
        else:
            self.half = np.linalg.norm(edges_m, axis=1) / 2.0
        self.planes = {axis: ("x-", "y-")[axis] for axis in halved}
        self.outer = [face for face in SIDES if face not in self.planes.values() and face not in free]
        self.boundary = np.unique(np.concatenate([mesh.nodes_of(face) for face in self.outer]))
        self.thickness = float(mesh.nodes[self.boundary, 2].max())
        self.inside = free_mask(mesh, self.outer)
        self.fields: StressFields | None = None
        self._known: dict[int, tuple[SymmetryClass, tuple[FloatArray, ...]]] = {}
        self.field = self._boundary_field(mesh)

    def check(self, cell: Cell) -> None:
        """Check the rigid-body modes and the mass of a reduced cell that moves freely. Errors as `check_rigid`."""
        mass, upright = self.system.mass, list(self.system.upright)
        if not self.system.grounded:
            whole, hung = float(mass.sum()), float(mass.diagonal()[upright].sum()) if upright else 0.0
            check_rigid(cell, self.copies * np.array([whole - hung, whole - hung, whole]), self.system.stressed)

    def _boundary_field(self, mesh: AnyMesh) -> FloatArray:
        """Scalar boundary functions at the boundary nodes, shape (b, count / 3)."""
        nodes = mesh.nodes[self.boundary]
        plan = nodes[:, :2] / self.half if self.edges_m is None else 2.0 * nodes[:, :2] @ np.linalg.inv(self.edges_m)
        return self.interface.evaluate(np.column_stack([plan, 2.0 * nodes[:, 2] / self.thickness - 1.0]))

    @cached_property
    def diagonal(self) -> IntArray | None:
        """Nodes under the mirror x <-> y of a quarter, (n,); None where mesh, materials or clamped sides differ
        along x and y.
        """
        turned = {face.translate(str.maketrans("xy", "yx")) for face in self.outer}
        square = self.halved == (0, 1) and turned == set(self.outer)
        return diagonal_mirror(self.system) if square else None

    def swapped(self, part: SymmetryClass) -> SymmetryClass:
        """Return the class with x and y exchanged: u'_x(x, y) = u_y(y, x)."""
        assert self.diagonal is not None
        shapes = part.shapes.reshape(len(self.diagonal), 3, -1)[self.diagonal][:, [1, 0, 2]]
        signs = {0: part.signs[1], 1: part.signs[0]}
        basis, shapes = part.basis[self.interface.diagonal()], shapes.reshape(part.shapes.shape)
        return replace(part, signs=signs, basis=basis, shapes=shapes, turned=part)

    def classes(self, top_hz: float, bounded: bool = True) -> list[SymmetryClass]:
        """Every symmetry class reduced; where x and y are alike, the class (-, +) is (+, -) turned over.

        bounded: with bounds of the discarded modes, which a mesh used only for an error estimate does not need.
        """
        classes = list(product((1, -1), repeat=len(self.halved)))
        turned = {(-1, 1)} if self.diagonal is not None else set()
        tasks = [(signs, half) for signs in classes if signs not in turned for half in self._halves(signs)]
        named = [(dict(zip(self.halved, signs, strict=True)), half) for signs, half in tasks]
        reduced = parallel_map(lambda task: self.reduce(*task, top_hz, bounded), named)
        parts = {
            signs: _together([part for task, part in zip(tasks, reduced, strict=True) if task[0] == signs])
            for signs, _ in tasks
        }
        return [parts[signs] if signs in parts else self.swapped(parts[signs[::-1]]) for signs in classes]

    def _halves(self, signs: tuple[int, ...]) -> tuple[int, ...]:
        """Halves of a class under the mirror x <-> y: invariant (1) and sign-changing (-1); 0 where x and y differ."""
        return (1, -1) if self.diagonal is not None and signs[0] == signs[1] else (0,)

    def _inside(self, signs: dict[int, int]) -> BoolArray:
        """Free degrees of freedom (n, 3) of one symmetry class."""
        mirrors = {face: "S" if signs[axis] > 0 else "A" for axis, face in self.planes.items()}
        inside = self.inside & free_mask(self.system.mesh, (), mirrors)
        inside[list(self.system.upright), :2] = False
        return inside

    def _at_boundary(self, basis: FloatArray) -> FloatArray:
        """The boundary's motion P, zero inside, (3n, m)."""
        full = np.zeros((len(self.system.mesh.nodes), 3, basis.shape[1]))
        for axis in range(3):
            full[self.boundary, axis] = self.field @ basis[axis::3]
        return full.reshape(-1, basis.shape[1])

    def _pull(self, shapes: FloatArray) -> FloatArray:
        """K_IB P at every node, (3n, m): few rows move, and no product over the whole panel is needed."""
        moved = np.flatnonzero(shapes.any(axis=1))
        return np.asarray(self.system.stiffness[moved].T @ shapes[moved])

    def clamp(self, signs: dict[int, int], half: int = 0) -> ClampedBoundaryClass:
        """The constraint shapes of one symmetry class, or of its half under x <-> y: K_II Psi = -K_IB P."""
        sector, basis = self._sector(signs, half), self.interface.parity_basis(signs, half)
        factorise, pencil = Factoriser(), sector.pencil  # one symbolic analysis serves the shifted matrices too
        # stored zeros dropped, as in every shifted matrix
        factor = factorise(sp.csc_array(pencil.stiffness - 0.0 * pencil.mass))
        shapes = self._at_boundary(basis)
        for own in _blocks(shapes):
            shapes[:, own] -= sector.spread(factor.solve(sector.restrict(self._pull(shapes[:, own]))))
        if not self.system.grounded:
            self._move_rigidly(basis, shapes)
        return ClampedBoundaryClass(basis, shapes, sector, factorise, factor)

    def _move_rigidly(self, basis: FloatArray, shapes: FloatArray) -> None:
        """Make constraint shapes (3n, m) follow a rigid-body motion of the boundary exactly.

        A solve leaves an error of the stiffest entry over the softest connection: 3e-6 of the motion of a lead tip on rubber.
        """
        size_m = (2.0 * float(self.half[0]), 2.0 * float(self.half[1]), self.thickness)
        rigid = rigid_polynomials(self.interface, size_m, self.edges_m)
        own = basis.T @ rigid
        own[np.abs(own) < SAME * np.abs(rigid).max()] = 0.0  # motions of other classes
        middle = np.array([0.0, 0.0, self.thickness / 2.0])
        within = np.linalg.lstsq(rigid, basis @ own, rcond=None)[0]  # a class's part of a rigid-body motion is one, too
        motions = rigid_body_modes(self.system.mesh.nodes, middle, max(size_m) / 2.0).reshape(-1, 3, 6)
        motions[list(self.system.upright), :2] = 0.0
        missed, back = motions.reshape(-1, 6) @ within - shapes @ own, np.linalg.pinv(own, rcond=SAME)
        for each in _blocks(shapes):
            shapes[:, each] += missed @ back[:, each]

    def _sector(self, signs: dict[int, int], half: int) -> Sector:
        inside = self._inside(signs)
        if not half:
            return ClassSector(self.system, inside)
        assert self.diagonal is not None
        return DiagonalSector(self.system, self.diagonal, inside, half)

    def reduce(self, signs: dict[int, int], half: int, top_hz: float, bounded: bool = True) -> SymmetryClass:
        """Constraint shapes and fixed-interface modes of one symmetry class, or of half of it."""
        clamped = self.clamp(signs, half)
        pencil, factor = clamped.sector.pencil, clamped.factor
        modes = modes_in_band(pencil, 0.0, top_hz, Shared(clamped.factorise, factor))
        dropped, flexible = top_hz, np.zeros((clamped.basis.shape[1],) * 2)
        if bounded:
            if not len(modes.frequency_hz):  # the lowest mode where that lies above the top of the count
                dropped = max(top_hz, lowest_hz(pencil, factor))
            pushed = clamped.sector.restrict(on_components(self.system.mass, clamped.shapes))
            flexible = _left_out(pencil, modes.vectors, pushed, factor)
        shapes = np.hstack([clamped.shapes, clamped.sector.spread(modes.vectors)])
        return SymmetryClass(signs, clamped.basis, shapes, modes.frequency_hz, dropped, flexible)

    def join(self, parts: list[SymmetryClass]) -> Cell:
        """One cell from its symmetry classes: block-diagonal in the classes, then in the sides' own degrees of freedom."""
        system, interface = self.system, self.interface
        fixed = np.concatenate([part.fixed_hz for part in parts])
        places = self.places(parts)
        parallel_map(self.projected, [part for part in parts if not part.turned])
        count, own_loss = places[0].shape[0], isinstance(system.loss, sp.csr_array)
        matrices = np.zeros((3 + own_loss + len(system.by_material), count, count))
        for part, place in zip(parts, places, strict=True):
            for whole, own in zip(matrices, self.projected(part), strict=True):
                whole += self.copies * place @ own @ place.T
        stiffness, mass, pillar, *more = matrices
        loss, by_material = more[0] if own_loss else None, matrices[3 + own_loss :]
        symmetry = [[part.signs.get(axis, 0) for axis in (0, 1)] for part in parts for _ in part.fixed_hz]
        return Cell(
            (stiffness + stiffness.T) / 2.0,
            (mass + mass.T) / 2.0,
            pillar,
            interface,
            system.scale,
            (2.0 * float(self.half[0]), 2.0 * float(self.half[1]), self.thickness),
            fixed,
            np.array(symmetry, dtype=np.int64).reshape(-1, 2),
            min(part.dropped_hz for part in parts),
            self._dropped(parts, places),
            self._touch(parts, places),
            self._skin(parts, places),
            system.mesh.dof * self.copies,
            bare=self._bare(parts, places),
            loss=None if loss is None else (loss + loss.T) / 2.0,
            grounded=system.grounded,
            edges_m=self.edges_m,
            by_material=(by_material + by_material.swapaxes(1, 2)) / 2.0 if len(by_material) else None,
            prestress=self._prestress(parts, places),
        )

    def _prestress(self, parts: list[SymmetryClass], places: list[FloatArray]) -> Prestress | None:
        if self.fields is None:
            return None
        sector = ClassSector(self.system, self._inside(dict.fromkeys(self.halved, 1)))
        inner = Factoriser()(sector.pencil.stiffness).solve(self.fields.load[sector.keep])
        fields = self.fields.relaxed(self.system.stiffness, sector.spread(inner[:, None])[:, 0])
        classes = [(part.signs, part.shapes, place) for part, place in zip(parts, places, strict=True)]
        return joined(fields, classes, self.halved, places[0].shape[0])

    def _dropped(self, parts: list[SymmetryClass], places: list[FloatArray]) -> FloatArray:
        """Cell.dropped, (boundary, boundary): the discarded modes of all symmetry classes together."""
        own = self.interface.count
        out = np.zeros((own, own))
        for part, place in zip(parts, places, strict=True):
            basis = place[:own, : part.basis.shape[1]]
            out += self.copies * basis @ part.flexibility @ basis.T
        return (out + out.T) / 2.0

    def projected(self, part: SymmetryClass) -> tuple[FloatArray, ...]:
        """V'KV, V'MV, V'MV of the pillar alone, where materials lose differently the loss, and the part of each material in
        V'KV if asked for, (m, m) each; computed once a class, and for one turned over with it.
        """
        own = part.turned or part
        if id(own) not in self._known:
            self._known[id(own)] = own, self._projection(own)
        return self._known[id(own)][1]

    def _projection(self, part: SymmetryClass) -> tuple[FloatArray, ...]:
        system, shapes = self.system, part.shapes
        pillar = system.region_mass(*system.mesh.standing)
        lost = [system.loss] if isinstance(system.loss, sp.csr_array) else []
        stiffness, *more = (
            projected(shapes, each.__matmul__) for each in (system.stiffness, *lost, *system.by_material)
        )
        mass = weighted(shapes, system.mass)
        heavy = np.zeros_like(mass) if pillar is None else weighted(shapes, pillar)
        return stiffness, mass, heavy, *more

    def places(self, parts: list[SymmetryClass]) -> list[FloatArray]:
        """Map from each class's degrees of freedom to the cell's, (dof, m)."""
        return places_of([part.basis for part in parts], [len(part.fixed_hz) for part in parts])

    def _mirrored(
        self, points: FloatArray, rows: list[FloatArray], parts: list[SymmetryClass], places: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Points and matrices on every mirror image; rows[c] (p, 3 or 1, m) is the class's field at the points."""
        moved = [row @ place.T for row, place in zip(rows, places, strict=True)]
        return mirrored(points, moved, [part.signs for part in parts], self.halved)

    def _touch(self, parts: list[SymmetryClass], places: list[FloatArray]) -> Expansion:
        mesh = self.system.mesh
        (facets,) = mesh.facets_of("touch")
        used, local = np.unique(facets, return_inverse=True)
        rows = [part.shapes[2::3][used][:, None, :] for part in parts]
        points, matrix = self._mirrored(mesh.nodes[used], rows, parts, places)
        return Expansion(points, matrix, facets=self._copied(local.reshape(facets.shape), len(used)), order=mesh.order)

    def _copied(self, facets: IntArray, nodes: int) -> IntArray:
        """Facets (m, corners) on every mirror image of `count` nodes."""
        return np.concatenate([facets + copy * nodes for copy in range(self.copies)])

    def _skin(self, parts: list[SymmetryClass], places: list[FloatArray]) -> Expansion:
        mesh = self.system.mesh
        inner = [*self.outer, *self.planes.values()]  # to which another panel, or the panel's own image, is joined
        hidden = [np.isin(skin_faces(mesh), mesh.nodes_of(face)).all(axis=1) for face in inner]
        facets = skin_faces(mesh)[~np.any(hidden, axis=0)]
        used, local = np.unique(facets, return_inverse=True)
        points, matrix = self._at_nodes(used, parts, places)
        return Expansion(points, matrix, facets=self._copied(local.reshape(facets.shape), len(used)))

    def _bare(self, parts: list[SymmetryClass], places: list[FloatArray]) -> Expansion | None:
        mesh, nodes = self.system.mesh, self._bare_nodes()
        if mesh.kind != "hex" or not self._is_grid(mesh.nodes[nodes]):
            return None
        points, matrix = self._at_nodes(nodes, parts, places)
        # in one order, each once though a mirror holds it twice
        _, first = np.unique(np.round(points / (SAME * self.thickness)), axis=0, return_index=True)
        return Expansion(points[first], matrix[first], order=mesh.order)

    def _bare_nodes(self) -> IntArray:
        """Nodes of the mesh on the plate's faces that carry nothing."""
        height = self.system.mesh.nodes[:, 2]
        levels = [0.0] if height.max() > (1.0 + SAME) * self.thickness else [0.0, self.thickness]
        return np.flatnonzero(np.abs(height[:, None] - levels).min(axis=1) < SAME * self.thickness)

    def _is_grid(self, points: FloatArray) -> bool:
        """Whether points of the plate's faces are tensor grids, as about every foot that is a union of rectangles."""
        x, y, z = (len(np.unique(np.round(points[:, axis] / (SAME * self.thickness)))) for axis in range(3))
        return x * y * z == len(points)

    def _at_nodes(
        self, nodes: IntArray, parts: list[SymmetryClass], places: list[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Points and matrices of nodes of the mesh and their mirror images."""
        rows = [part.shapes.reshape(len(self.system.mesh.nodes), 3, -1)[nodes] for part in parts]
        return self._mirrored(self.system.mesh.nodes[nodes], rows, parts, places)


def _together(halves: list[SymmetryClass]) -> SymmetryClass:
    """One symmetry class from its halves, the fixed-interface modes in ascending order."""
    if len(halves) == 1:
        return halves[0]
    fixed_hz = np.concatenate([half.fixed_hz for half in halves])
    order = np.argsort(fixed_hz, kind="stable")
    widths = [half.basis.shape[1] for half in halves]
    clamped = [half.shapes[:, :width] for half, width in zip(halves, widths, strict=True)]
    fixed = np.hstack([half.shapes[:, width:] for half, width in zip(halves, widths, strict=True)])
    return SymmetryClass(
        halves[0].signs,
        np.hstack([half.basis for half in halves]),
        np.hstack([*clamped, fixed[:, order]]),
        fixed_hz[order],
        min(half.dropped_hz for half in halves),
        block_diag(*[half.flexibility for half in halves]),
    )


def _left_out(pencil: PlainPencil, kept: FloatArray, pushed: FloatArray, factor: Factor) -> FloatArray:
    """R' K_II^-1 R, R the part of the loads M Psi (free, m) that no mode kept (free, k) answers to, (m, m).

    Loads and answers are projected, R = (1 - M Phi Phi') M Psi: the lowest mode of a slender rod is 1e8 times as flexible as
    all discarded modes together, and a difference of the two would be rounding.
    """
    heavy = pencil.apply_mass(kept)
    rest = pushed - heavy @ (kept.T @ pushed)

    def answer(loads: FloatArray) -> FloatArray:
        own = factor.solve(loads)
        return np.asarray(own - kept @ (heavy.T @ own))

    return projected(rest, answer)


def weighted(shapes: FloatArray, mass: sp.csr_array) -> FloatArray:
    """Project a scalar mass on nodal shapes: V' (m (x) I3) V.

    Parameters
    ----------
    shapes : ndarray, shape (3n, m)
        Nodal shapes, component fastest.
    mass : csr_array, shape (n, n)
        Scalar mass, which acts on each component alike, scaled.

    Returns
    -------
    ndarray, shape (m, m)
        Projected mass, scaled.
    """
    return projected(shapes, partial(on_components, mass))


def _blocks(shapes: FloatArray) -> list[slice]:
    """Columns that are computed at once."""
    return [slice(first, first + AT_ONCE) for first in range(0, shapes.shape[1], AT_ONCE)]


def projected(shapes: FloatArray, apply: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Project a symmetric map on nodal shapes, without its image of all of them: V' A V.

    Parameters
    ----------
    shapes : ndarray, shape (n, m)
        V.
    apply : callable
        Returns A times some columns.

    Returns
    -------
    ndarray, shape (m, m)
        In the units of A.
    """
    out = np.empty((shapes.shape[1],) * 2)
    for own in _blocks(shapes):
        out[: own.stop, own] = shapes[:, : own.stop].T @ apply(shapes[:, own])
        out[own, : own.start] = out[: own.start, own].T
    return out
