"""Memory and operations of a modal solve, estimated before anything is assembled."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

from solvers.fem.block_lanczos import Basis
from solvers.machine import factorisations

# -- fill of nested dissection -----------------------------------------------------------------------------------------
# What a nested dissection of a regular grid leads to: entries of the factor and operations, without a matrix
# (george1973).
# A box of elements is cut in halves by a plane of nodes until one element is left. Eliminating m degrees of freedom
# that b others surround fills m (m + 1)/2 + m b entries and takes m^3/3 + m^2 b + m b^2 operations.

Ends = tuple[bool, bool]  # whether the planes at the lower and the upper end belong to the box itself
T = TypeVar("T")
Dofs = Callable[[list[int], list[int]], float]


@dataclass(frozen=True)
class Fill:
    """Entries of L, operations (a multiplication with an addition), and the largest front's entries."""

    entries: float = 0.0
    operations: float = 0.0
    front: float = 0.0

    def __add__(self, other: Fill) -> Fill:
        return Fill(self.entries + other.entries, self.operations + other.operations, max(self.front, other.front))

    def times(self, count: int) -> Fill:
        """Fill of `count` bodies."""
        return Fill(count * self.entries, count * self.operations, self.front)


def eliminated(inside: float, around: float) -> Fill:
    """Compute the fill of one front.

    Parameters
    ----------
    inside, around : float
        Numbers of degrees of freedom that are eliminated, and that remain.

    Returns
    -------
    Fill
        Entries, operations and the size of the front.
    """
    m, b = inside, around
    return Fill(m * (m + 1.0) / 2.0 + m * b, m**3 / 3.0 + m * m * b + m * b * b, (m + b) ** 2)


def grid_fill(elements: tuple[int, ...], dofs: Dofs, ends: tuple[Ends, ...] | None = None) -> Fill:
    """Compute the fill of a grid of elements with any number of axes under nested dissection.

    Parameters
    ----------
    elements : tuple of int
        Number of elements along each axis.
    dofs : callable
        Degrees of freedom of a box from its planes of nodes and from its elements, one number per axis.
    ends : tuple of (bool, bool), optional
        Which end planes belong to the grid; all by default.

    Returns
    -------
    Fill
        Entries, operations and the largest front.
    """

    def own(elements: tuple[int, ...], ends: tuple[Ends, ...], plane: int | None = None) -> float:
        """Fill of a box, or of the single plane of nodes that cuts it across an axis."""
        lines = [count - 1 + low + high for count, (low, high) in zip(elements, ends, strict=True)]
        gaps = list(elements)
        if plane is not None:
            lines[plane], gaps[plane] = 1, 0
        return dofs(lines, gaps)

    @cache
    def fill(elements: tuple[int, ...], ends: tuple[Ends, ...]) -> Fill:
        inside = own(elements, ends)
        around = own(elements, ((True, True),) * len(elements)) - inside
        planes = {axis: own(elements, ends, axis) for axis, count in enumerate(elements) if count > 1}
        if not planes:
            return eliminated(inside, around)
        axis = min(planes, key=lambda each: planes[each])
        half, (low, high) = elements[axis] // 2, ends[axis]
        lower = fill(_put(elements, axis, half), _put(ends, axis, (low, False)))
        upper = fill(_put(elements, axis, elements[axis] - half), _put(ends, axis, (False, high)))
        return eliminated(planes[axis], around) + lower + upper

    return fill(elements, ends or ((True, True),) * len(elements))


def nodal(order: int, a_node: int = 3) -> Dofs:
    """Count the degrees of freedom of hexahedra.

    Parameters
    ----------
    order : int
        Order of the elements.
    a_node : int, optional
        Degrees of freedom per node.

    Returns
    -------
    callable
        As `grid_fill` takes it.
    """

    def dofs(lines: list[int], gaps: list[int]) -> float:
        total = float(a_node)
        for line, gap in zip(lines, gaps, strict=True):
            total *= line + (order - 1) * gap
        return total

    return dofs


def panelled(vertex: float, side: float, inner: float) -> Dofs:
    """Count the degrees of freedom of reduced panels in a plane.

    Parameters
    ----------
    vertex, side : float
        Degrees of freedom per vertex line and per side.
    inner : float
        Number within each panel.

    Returns
    -------
    callable
        As `grid_fill` takes it.
    """

    def dofs(lines: list[int], gaps: list[int]) -> float:
        corners, sides = lines[0] * lines[1], lines[0] * gaps[1] + lines[1] * gaps[0]
        return float(vertex * corners + side * sides + inner * gaps[0] * gaps[1])

    return dofs


def _put(values: tuple[T, ...], axis: int, value: T) -> tuple[T, ...]:
    return (*values[:axis], value, *values[axis + 1 :])


# -- solves ------------------------------------------------------------------------------------------------------------
# Cost of a modal solve, estimated before anything is assembled: bytes of its stages, and operations.
# Bytes follow from the arrays that `assembly`, `solid` and `eigen` hold at once, counted in entries; those of a
# factorisation from the fill above with measured factors (`studies/benchmarks/resource_estimate.py`).

LARGE = 200_000  # degrees of freedom beyond which whole solids hold no second copy of their matrices
ENTRY = 12  # bytes of a sparse matrix's entry: a number and a column
STIFFNESS, MASS = 9 * ENTRY, 3 * ENTRY  # per pair of nodes, of K and of M with three components
# bytes of an entry of the dissected factor: at the peak of the factorisation, and afterwards
FACTOR = {"rslab": (30.0, 15.0), "superlu": (75.0, 60.0)}
ANALYSIS, COPY = 60, 30  # bytes per entry of the matrix: the analysis, and the part that stays next to the factor
VECTORS = 8  # copies of the modes' vectors while they are verified
DENSE_GAIN = 2.0  # speed of a front's operations relative to those on vectors
FACTORISATIONS = 4  # factorisations of one band: both ends, the shift, one more if it is halved
SOLVES = 3.0  # a mode
BASIS = 2.5  # vectors of the basis per pair, when Lanczos has converged


@dataclass(frozen=True)
class Stage:
    """A stage of a computation and the bytes that it holds at its peak."""

    name: str
    bytes: float


@dataclass(frozen=True)
class Cost:
    """Stages one after another, operations, and the degrees of freedom of the largest system solved at once."""

    stages: tuple[Stage, ...] = ()
    operations: float = 0.0
    dofs: int = 0

    @property
    def peak(self) -> Stage:
        """The stage that takes most."""
        return max(self.stages, key=lambda stage: stage.bytes, default=Stage("nothing", 0.0))

    def then(self, other: Cost, kept_bytes: float = 0.0) -> Cost:
        """Another computation after this one, while `kept_bytes` of this one stay."""
        later = tuple(Stage(stage.name, stage.bytes + kept_bytes) for stage in other.stages)
        operations = self.operations + other.operations
        return Cost(self.stages + later, operations, max(self.dofs, other.dofs))


@dataclass(frozen=True)
class MeshCounts:
    """Elements with `corners` nodes each, nodes, ordered pairs of nodes that share an element, and the factor's fill."""

    elements: float
    corners: int
    nodes: float
    pairs: float
    fill: Fill

    @property
    def dofs(self) -> float:
        """Displacements before any constraint."""
        return 3.0 * self.nodes

    @property
    def mesh_bytes(self) -> float:
        """Nodes and elements."""
        return 24.0 * self.nodes + 8.0 * self.elements * self.corners


def assembly(mesh: MeshCounts) -> Cost:
    """Estimate the cost of meshing and of assembling K and M.

    Parameters
    ----------
    mesh : MeshCounts
        Numbers of elements, nodes and entries.

    Returns
    -------
    Cost
        Memory in bytes by stage, and operations.
    """
    entries = mesh.elements * mesh.corners**2
    making = Stage("meshing", mesh.mesh_bytes + 48.0 * mesh.elements * mesh.corners)
    summing = Stage("assembling the matrices", mesh.mesh_bytes + 20.0 * entries + (STIFFNESS + 24.0) * mesh.pairs)
    return Cost((making, summing), 30.0 * entries, round(mesh.dofs))


def factorisation(dofs: float, entries: float, fill: Fill, times: float) -> Cost:
    """Estimate the cost of factorisations of one matrix, of which one is kept at a time.

    Parameters
    ----------
    dofs, entries : float
        Numbers of degrees of freedom and of entries of the matrix.
    fill : Fill
        Of its factor.
    times : float
        Number of factorisations.

    Returns
    -------
    Cost
        Memory in bytes by stage, and operations.
    """
    peak, _ = FACTOR[factorisations()[0]]
    stages = (
        Stage("analysing the factorisation", ANALYSIS * entries),
        Stage("factorising", peak * fill.entries + COPY * entries),
    )
    return Cost(stages, times * fill.operations / DENSE_GAIN, round(dofs))


def modal_solve(dofs: float, entries: float, fill: Fill, modes: float, near: bool = False) -> Cost:
    """Estimate the cost of eigenpairs of a pencil.

    Parameters
    ----------
    dofs, entries : float
        Numbers of degrees of freedom and of entries of a matrix.
    fill : Fill
        Of its factor.
    modes : float
        Number of eigenpairs.
    near : bool, optional
        All at once around a frequency, not by slices of a band.

    Returns
    -------
    Cost
        Memory in bytes by stage, and operations.
    """
    kept = FACTOR[factorisations()[0]][1] * fill.entries + COPY * entries
    most = Basis.slice_of(max(round(dofs), 1))
    at_once = modes if near else min(modes, most)
    if modes >= dofs - 1.0:
        return Cost((Stage("a dense eigen-solve", 6.0 * 8.0 * dofs**2),), 10.0 * dofs**3, round(dofs))
    size, count = round(dofs), max(1, round(1.1 * at_once) + 4)
    block = min(Basis.most(size, count), BASIS * count + 64.0)
    basis = 16.0 * size * block if Basis.fits(size, count) else 8.0 * size * (3.0 * count + 32.0)
    slices = max(1.0, modes / most) if not near else 1.0
    stages = (
        Stage("the Lanczos vectors", kept + basis + 16.0 * size * modes),
        Stage("the modes' vectors", ENTRY * entries + VECTORS * 8.0 * size * modes),
    )
    solves = SOLVES * modes + 40.0 * slices
    sweeps = 8.0 * fill.entries * solves + 4.0 * size * (2.5 * count) ** 2 * slices
    shifts = FACTORISATIONS + 2.0 * (slices - 1.0)
    return factorisation(dofs, entries, fill, shifts).then(Cost(stages, sweeps, size))


def solid_modes(mesh: MeshCounts, classes: int, modes: float, near: bool = False) -> Cost:
    """Estimate the cost of the modes of a meshed body, whose symmetry classes are solved one after another.

    Parameters
    ----------
    mesh : MeshCounts
        Numbers of elements, nodes and entries.
    classes : int
        Number of symmetry classes.
    modes : float
        Number of modes of each.
    near : bool, optional
        All at once around a frequency, not by slices of a band.

    Returns
    -------
    Cost
        Memory in bytes by stage, and operations.
    """
    large = mesh.dofs > LARGE
    mesh_and_matrices = mesh.mesh_bytes + (STIFFNESS * (1 if large else 2) + MASS + ENTRY) * mesh.pairs
    restricted = Stage("selecting the free degrees of freedom", mesh.mesh_bytes + (3 * STIFFNESS + ENTRY) * mesh.pairs)
    solve = modal_solve(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, modes, near)
    whole = assembly(mesh).then(Cost((restricted,)))
    shifted = STIFFNESS * mesh.pairs
    kept = (classes - 1) * 8.0 * mesh.dofs * modes
    cost = whole.then(solve, mesh_and_matrices + shifted + kept)
    return Cost(cost.stages, classes * solve.operations + whole.operations, cost.dofs)
