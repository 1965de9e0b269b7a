"""One symmetry class of the affine cell: its degrees of freedom, boundary functions and the reduced basis of its inside.

Classes: u_z even or odd under x -> -x and y -> -y. Where the cell is its own image with x and y exchanged, classes alike in
both are parted into even and odd under x <-> y, and (+, -) stands for (-, +) too. A basis function is either a boundary
function, zero at every inner node, or zero on the boundary.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import add

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from solvers.errors import SolverError
from solvers.fem.block_lanczos import block_lanczos
from solvers.fem.factor import Factor, Factoriser
from solvers.fem.solid import free_mask, rigid_body_modes
from solvers.parametric.affine import AffineCell, Sizes
from solvers.superelement.interface import Interface
from solvers.superelement.symmetry import diagonal_folding, diagonal_image

BESIDE = 0.1  # scaled eigenvalue: about a tenth band
ROUGH = 1e-3  # residual of a clamped mode: a basis does not ask for more
FUNCTION = 1e-11  # of the largest singular value: smaller ones are rounding


@dataclass(frozen=True)
class ClassForms:
    """A symmetry class's affine matrices among its own degrees of freedom, all of one sparsity pattern.

    stiffness (q, nnz), mass (r, nnz): values; indices, indptr: the pattern of (m, m); fold (3n, m): nodal motion.
    """

    fold: sp.csr_array
    stiffness: FloatArray
    mass: FloatArray
    stiffness_pattern: tuple[IntArray, IntArray]
    mass_pattern: tuple[IntArray, IntArray]

    @property
    def dof(self) -> int:
        """Degrees of freedom of the class."""
        return int(self.fold.shape[1])

    def matrix(self, kind: str, weights: FloatArray) -> sp.csc_array:
        """sum_q theta_q A_q of "stiffness" or "mass"; symmetric, so that rows serve as columns."""
        indices, indptr = getattr(self, f"{kind}_pattern")
        return sp.csc_array((weights @ getattr(self, kind), indices, indptr), shape=(self.dof,) * 2)

    def each(self, kind: str) -> Iterator[sp.csc_array]:
        """A_q after A_q, each without what only the others fill."""
        for chosen in np.eye(len(getattr(self, kind))):
            matrix = self.matrix(kind, chosen).copy()  # the pattern is everybody's
            matrix.eliminate_zeros()
            yield matrix


def class_forms(cell: AffineCell, signs: tuple[int, int, int]) -> ClassForms:
    """The affine forms of one symmetry class."""
    mirrors = {face: "S" if sign > 0 else "A" for face, sign in zip(("x-", "y-"), signs, strict=False)}
    inside = free_mask(cell.mesh, (), mirrors)
    if signs[2]:
        image = diagonal_image(cell.mesh)
        assert image is not None  # the quarter's lines are alike along x and y
        fold = diagonal_folding(image, inside, signs[2])
    else:
        own = np.flatnonzero(inside.ravel())
        fold = sp.csr_array((np.ones(len(own)), (own, np.arange(len(own)))), shape=(cell.mesh.dof, len(own)))
    eye = sp.eye_array(3, format="csr")
    stiffness, k_pattern = _folded(fold, list(cell.stiffness.matrices))
    mass, m_pattern = _folded(fold, [sp.csr_array(sp.kron(m, eye, format="csr")) for m in cell.mass.matrices])
    return ClassForms(fold, stiffness, mass, k_pattern, m_pattern)


def _folded(fold: sp.csr_array, matrices: list[sp.csr_array]) -> tuple[FloatArray, tuple[IntArray, IntArray]]:
    """F'AF of matrices in the pattern that holds all of them: values (q, nnz) and that pattern."""
    products = [sp.csr_array(fold.T @ (matrix @ fold)) for matrix in matrices]
    for one in products:
        one.eliminate_zeros()
    pattern = reduce(add, (abs(one) for one in products))  # no sum of absolute values vanishes
    pattern.sort_indices()
    places = sp.csr_array((np.arange(1, pattern.nnz + 1), pattern.indices, pattern.indptr), shape=pattern.shape)
    values = np.zeros((len(products), pattern.nnz))
    for own, one in zip(values, products, strict=True):
        one.sort_indices()
        there = sp.csr_array((np.ones(one.nnz, dtype=np.int64), one.indices, one.indptr), shape=one.shape)
        own[places.multiply(there).tocsr().data - 1] = one.data
    return values, (pattern.indices, pattern.indptr)


class Block:
    """One class with its boundary functions at any design: P(mu) = functions @ coordinates(mu)."""

    def __init__(self, cell: AffineCell, interface: Interface, signs: tuple[int, int, int]) -> None:
        self.cell, self.interface, self.signs = cell, interface, signs
        self.forms = class_forms(cell, signs)
        self.parity = interface.parity_basis({0: signs[0], 1: signs[1]}, signs[2])
        mesh = cell.mesh
        self.boundary_nodes = np.unique(np.concatenate([mesh.nodes_of("x+"), mesh.nodes_of("y+")]))
        rows = (3 * self.boundary_nodes[:, None] + np.arange(3)).ravel()
        self.on_boundary = np.unique(self.forms.fold[rows].indices)
        self.inner = np.setdiff1d(np.arange(self.forms.dof), self.on_boundary)
        self.functions = self._functions()
        self.factorise = Factoriser()  # one symbolic analysis among all designs

    def traces(self, sizes: FloatArray | Sizes) -> FloatArray:
        """The class's boundary polynomials of a stretched cell at its boundary degrees of freedom, (b, m)."""
        nodes = self.cell.plan(self.cell.mesh.nodes[self.boundary_nodes], sizes)
        own = 2.0 * nodes / self.cell.box.panel_m(sizes) - [0.0, 0.0, 1.0]
        field = self.interface.evaluate(own)
        motion = np.stack([field @ self.parity[axis::3] for axis in range(3)], axis=1).reshape(-1, self.parity.shape[1])
        rows = (3 * self.boundary_nodes[:, None] + np.arange(3)).ravel()
        return np.asarray(self.forms.fold[rows][:, self.on_boundary].T @ motion)

    def _functions(self) -> FloatArray:
        """Orthonormal functions that hold the polynomials of every ratio of the block's width to the panel's, (b, f).

        The polynomials are polynomials of that ratio too, of at most their degree + 1: so many samples span them all.
        """
        stacked = np.hstack([self.traces(self.of_share(share)) for share in self.shares])
        left, size, _ = np.linalg.svd(stacked, full_matrices=False)
        return np.asarray(left[:, size > FUNCTION * size[0]])

    @property
    def shares(self) -> FloatArray:
        """Ratios of the block's width to the panel's that determine the polynomials at any other: Chebyshev points."""
        count = self.interface.along + 2
        return np.asarray(0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count))

    def of_share(self, share: float) -> Sizes:
        """The reference design with a block of another share of the panel's smaller width."""
        (t, h, _, p), box = self.cell.reference, self.cell.box
        return t, h, float(share) * box.narrow * p / box.foot.reach, p

    def stretched(self, sizes: FloatArray | Sizes) -> tuple[sp.csc_array, sp.csc_array]:
        """K and M of the class at a design."""
        cell, forms = self.cell, self.forms
        return (
            forms.matrix("stiffness", cell.theta(cell.stiffness, sizes)),
            forms.matrix("mass", cell.theta(cell.mass, sizes)),
        )

    def rigid(self, sizes: FloatArray | Sizes) -> FloatArray:
        """The inside of a design's rigid-body modes as far as they belong to the class, (inner, 6)."""
        motions = rigid_body_modes(self.cell.plan(self.cell.mesh.nodes, sizes)).reshape(-1, 6)
        return np.asarray((self.forms.fold.T @ motions)[self.inner])

    @cached_property
    def _places(self) -> dict[str, tuple[sp.csc_array, sp.csc_array]]:
        """Where among the values of K and M the inside's rows stand: those among themselves, those beside the boundary."""
        return {kind: self._place(kind) for kind in ("stiffness", "mass")}

    def _place(self, kind: str) -> tuple[sp.csc_array, sp.csc_array]:
        indices, indptr = getattr(self.forms, f"{kind}_pattern")
        rows = sp.csc_array((np.arange(len(indices)), indices, indptr), shape=(self.forms.dof,) * 2)[self.inner]
        return rows[:, self.inner], rows[:, self.on_boundary]

    def inner_shapes(self, sizes: FloatArray | Sizes, modes: int) -> tuple[FloatArray, FloatArray]:
        """What the inside answers to the boundary's polynomials, and the lowest clamped modes: (inner, columns) each.

        Modes have unit strain energy, answers unit strain energy and BESIDE times their mass, for rigid-body modes have none.
        """
        stiffness, mass = self.stretched(sizes)
        inside, traces = self.inner, self.traces(sizes)
        clamped, beside = (_at(places, stiffness.data) for places in self._places["stiffness"])
        factor = self.factorise(clamped)
        pull = beside @ traces
        static = -factor.solve(np.asarray(pull))
        motion = np.zeros((self.forms.dof, traces.shape[1]))
        motion[self.on_boundary], motion[inside] = traces, static
        energy = np.einsum("ij,ij->j", motion, stiffness @ motion + BESIDE * (mass @ motion))
        fixed = _clamped_modes(_at(self._places["mass"][0], mass.data), factor, modes)
        return static / np.sqrt(energy), fixed


def _at(places: sp.csc_array, values: FloatArray) -> sp.csc_array:
    return sp.csc_array((values[places.data], places.indices, places.indptr), shape=places.shape)


def _clamped_modes(mass: sp.csc_array, factor: Factor, count: int) -> FloatArray:
    """The lowest modes, unit strain energy: functions for a basis, whose number nobody counts."""
    pairs = block_lanczos(factor.solve, lambda block: np.asarray(mass @ block), mass.shape[0], count, ROUGH)
    if pairs is None:
        raise SolverError("the clamped modes of a cell's inside did not converge")
    inverse, vectors = pairs
    return np.asarray(vectors * np.sqrt(inverse))
