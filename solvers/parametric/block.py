"""One symmetry class of the affine cell: its boundary functions, its basis over a box of designs, and mirror sectors.

Classes: u_z even or odd under x -> -x and y -> -y. Where the cell is its own image with x and y exchanged, classes alike in
both are parted into even and odd under x <-> y, and (+, -) stands for (-, +) too. A basis function is either a boundary
function, zero at every inner node, or zero on the boundary.

The half turn about the middle followed by conjugation leaves the waves at k among themselves, so that classes even under
that turn have real coordinates and the others imaginary ones (wigner1932); a mirror that leaves k alone parts the waves
into even and odd. A bare panel next to the pillar's has its coordinates about its own middle, times the phase there. Neither
the phases nor the bases depend on the design.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from operator import add

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.lattice import Lattice
from solvers.errors import SolverError
from solvers.fem.block_lanczos import block_lanczos
from solvers.fem.factor import Factor, Factoriser
from solvers.fem.solid import free_mask, rigid_body_modes
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import IN_LINE, AffineCell, Sizes
from solvers.parametric.bare import bare_forms, bare_parity
from solvers.superelement.interface import Interface, Ties
from solvers.superelement.symmetry import diagonal_folding, diagonal_image

BESIDE = 0.1  # scaled eigenvalue: about a tenth band
ROUGH = 1e-3  # residual of a clamped mode: a basis does not ask for more
FUNCTION = 1e-11  # of the largest singular value: smaller ones are rounding

MODES = 12  # clamped modes of every sampled design
NOVEL = 10.0  # times KEPT, relative to a snapshot's unit energy: a design that adds less is not used
RIGID = 1e-12  # of the largest energy of a rigid motion's inside: less is rounding
ALL = 1e-12  # of the energy: every function of a single design
KEPT = 1e-5  # of the largest: share of the snapshots' energy that a function must bring
ONCE = np.zeros((1, 6), dtype=np.int64)  # exponents of one design's own matrix

# of a bare panel's, whose stretches are the thickness and the pitch: by the derivatives across the plate, 0, 1 and 2
BARE_STIFFNESS = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1], [-1, 0, 0, 0, 0, 2]])

BARE_MASS = np.array([[1, 0, 0, 0, 0, 2]])
ASKED = 6  # clamped modes of a candidate design, in addition to its responses to the boundary

ROOT = float(np.sqrt(0.5))
RANK = 1e-9  # of the largest singular value
Signs = tuple[int, int, int]  # under x -> -x, y -> -y, x <-> y; 0 if the class lacks the last mirror
Member = tuple[int, float]  # a class among a symmetry's members and its factor in a sector
QUARTERS: tuple[Signs, ...] = ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0))
EVEN_X, EVEN_Y = ((((0, 1.0), (1, 1.0)), ((2, 1.0), (3, 1.0))), (((0, 1.0), (2, 1.0)), ((1, 1.0), (3, 1.0))))
LINES = {"GX": EVEN_Y, "XM": EVEN_X, "YM": EVEN_Y, "GY": EVEN_X}
INSIDE = ""  # name of no line


@dataclass(frozen=True)
class ClassForms:
    """A symmetry class's affine matrices among its own degrees of freedom, all of one sparsity pattern.

    stiffness (q, nnz), mass (r, nnz): values; their patterns: indices and indptr of (m, m); fold (3n, m): nodal motion.
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


class Block:
    """One class with its boundary functions at any design: P(mu) = functions @ coordinates(mu)."""

    def __init__(self, cell: AffineCell, interface: Interface, signs: tuple[int, int, int]) -> None:
        self.cell, self.interface, self.signs = cell, interface, signs
        self.forms = _class_forms(cell, signs)
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
        """Positions of the inside's rows among the values of K and M: inside with inside, and inside with boundary."""
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


@dataclass(frozen=True)
class ReducedBlock:
    """One class: signs under x -> -x, y -> -y, x <-> y; the first `functions` of n basis functions live on the boundary.

    stiffness (q, n, n), mass (r, n, n): the affine matrices, and the exponents of their stretches; touch (p, n): u_z at points
    of the touch face; shares (k,), coordinates (k, f, m): the boundary polynomials at ratios of the block's width to the
    panel's, themselves polynomials of that ratio of degree below k; parity (boundary, m): the polynomials among the cell's own.
    """

    signs: IntArray
    functions: int
    stiffness: FloatArray
    mass: FloatArray
    touch: FloatArray
    shares: FloatArray
    coordinates: FloatArray
    parity: FloatArray
    stiffness_exponents: IntArray
    mass_exponents: IntArray

    def boundary(self, share: float) -> FloatArray:
        """The boundary polynomials at a ratio of the block's width to the panel's among the boundary functions, (f, m)."""
        apart = share - self.shares
        others = ~np.eye(len(apart), dtype=bool)
        steps = self.shares[:, None] - self.shares
        weights = [np.prod(apart[keep] / step[keep]) for keep, step in zip(others, steps, strict=True)]
        return np.asarray(np.tensordot(weights, self.coordinates, axes=1))


@dataclass(frozen=True)
class Symmetry:
    """Classes of a cell that are reduced, members (those and their images), and the even and odd sector of each line of the
    zone: GX and YM under y -> -y, XM and GY under x -> -x, GM under x <-> y; all waves together elsewhere, where allowed.

    Of two panels the second one's classes come last.
    """

    classes: tuple[Signs, ...]
    members: tuple[Signs, ...]
    sectors: Mapping[str, tuple[tuple[Member, ...], tuple[Member, ...]]]


ALIKE = Symmetry(
    ((1, 1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1), (1, -1, 0)),
    ((1, 1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1), (1, -1, 0), (-1, 1, 0)),
    {
        "GX": (((0, 1.0), (1, 1.0), (5, 1.0)), ((2, 1.0), (3, 1.0), (4, 1.0))),
        "XM": (((0, 1.0), (1, 1.0), (4, 1.0)), ((2, 1.0), (3, 1.0), (5, 1.0))),
        "GM": (((0, 1.0), (2, 1.0), (4, ROOT), (5, ROOT)), ((1, 1.0), (3, 1.0), (4, ROOT), (5, -ROOT))),
    },
)  # x and y may be exchanged: (-, +) is (+, -) turned over


UNLIKE = Symmetry(QUARTERS, QUARTERS, LINES)


@dataclass(frozen=True)
class Sector:
    """Wavevectors of one line, and the waves of one sign under the mirror that leaves them alone.

    points (k,): their places in the path; classes: which reduced blocks take part; bases (k, rows, m): the classes'
    boundary polynomials, one below the other, from the sector's m free coordinates.
    """

    points: IntArray
    classes: tuple[int, ...]
    bases: FloatArray


def _class_forms(cell: AffineCell, signs: tuple[int, int, int]) -> ClassForms:
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


def reduced_block(block: Block, designs: Iterable[Sizes], everywhere: Iterable[Sizes] = ()) -> ReducedBlock:
    """Reduce a class to what its inside does at given designs, and project every matrix.

    Functions that carry more than KEPT of the energy are kept.

    Parameters
    ----------
    block : Block
        The class on its mesh.
    designs : iterable of tuple of float
        In m.
    everywhere : iterable of tuple of float, optional
        Designs, in m, whose rigid-body modes are also included.

    Returns
    -------
    ReducedBlock
        Matrices and their exponents.
    """
    basis = _inner_basis(block, designs, KEPT, everywhere)
    exponents = block.cell.stiffness.exponents, block.cell.mass.exponents
    return _block(block, basis, block.forms.each("stiffness"), block.forms.each("mass"), exponents)


def block_alone(block: Block, sizes: Sizes) -> ReducedBlock:
    """Reduce a class at one design, with all that its inside does there: one matrix of each kind with exponents zero.

    Parameters
    ----------
    block : Block
        The class on its mesh.
    sizes : tuple of float
        The design, in m.

    Returns
    -------
    ReducedBlock
        Valid at that design.
    """
    stiffness, mass = block.stretched(sizes)
    return _block(block, _inner_basis(block, [sizes], ALL), [stiffness], [mass], (ONCE, ONCE))


def bare_block(cell: AffineCell, interface: Interface, signs: Signs) -> ReducedBlock:
    """Build a class of the bare panel next to the pillar's; its polynomials stretch with thickness and pitch.

    Parameters
    ----------
    cell : AffineCell
        The panel with the pillar.
    interface : Interface
        Degrees along the sides and through the thickness.
    signs : tuple of int
        Signs of the class.

    Returns
    -------
    ReducedBlock
        Matrices and their exponents.
    """
    forms, mass = bare_forms(cell.box.panel_m(cell.reference), cell.plate, interface)
    own = bare_parity(interface, signs)
    b, parity = interface.count, interface.parity_basis({0: signs[0], 1: signs[1]})
    basis = np.zeros((len(mass), parity.shape[1] + len(own)))
    basis[:b, : parity.shape[1]], basis[b + own, parity.shape[1] + np.arange(len(own))] = parity, 1.0
    stiffness = np.array([basis.T @ form @ basis for form in forms])
    return ReducedBlock(
        np.array(signs), parity.shape[1], symmetric(stiffness) / 4.0, symmetric((basis.T @ mass @ basis)[None]) / 4.0,
        np.empty((0, basis.shape[1])), np.array([0.5]), np.eye(parity.shape[1])[None], parity,
        BARE_STIFFNESS, BARE_MASS,
    )  # fmt: skip


def _inner_basis(block: Block, designs: Iterable[Sizes], kept: float, everywhere: Iterable[Sizes] = ()) -> FloatArray:
    """Functions of the inside (inner, r), orthonormal in the strain energy of the reference design (a POD, sirovich1987).

    The rigid-body modes of every design are among them, so that none meets a force. What a design's snapshots add to those of
    the designs before widens the space; the decomposition is of all snapshots' coordinates in it.
    """
    designs = list(designs)
    stiffness, _ = block.stretched(block.cell.reference)
    energy = sp.csr_array(stiffness[block.inner][:, block.inner])
    space = orthonormal(np.hstack([block.rigid(sizes) for sizes in (*designs, *everywhere)]), energy, RIGID)
    rigid, known = space.shape[1], []
    for sizes in designs:
        snapshots = np.hstack(block.inner_shapes(sizes, MODES))
        weighted = energy @ snapshots
        new = orthonormal(snapshots - space @ (space.T @ weighted), energy, 0.0, NOVEL * kept)
        space = np.hstack([space, new])
        known.append(space.T @ weighted)
    coordinates = np.zeros((space.shape[1] - rigid, sum(one.shape[1] for one in known)))
    for one, column in zip(known, np.cumsum([0, *(one.shape[1] for one in known[:-1])]), strict=True):
        coordinates[: len(one) - rigid, column : column + one.shape[1]] = one[rigid:]
    size, turn = eigh(coordinates @ coordinates.T)
    return np.hstack([space[:, :rigid], space[:, rigid:] @ turn[:, size > kept * size[-1]]])


def orthonormal(functions: FloatArray, energy: sp.csr_array, kept: float, least: float = 0.0) -> FloatArray:
    """Build an orthonormal basis in energy of the span of functions.

    Parameters
    ----------
    functions : ndarray, shape (n, m)
        The functions.
    energy : sparse array, shape (n, n)
        Positive semidefinite form.
    kept, least : float
        Smallest energy of a kept direction: relative to the largest, and absolute (scaled).

    Returns
    -------
    ndarray, shape (n, r)
        Orthonormal in `energy`.
    """
    size, turn = eigh(functions.T @ (energy @ functions), overwrite_a=True, check_finite=False)
    chosen = size > max(kept * size[-1], least)
    return np.asarray(functions @ (turn[:, chosen] / np.sqrt(size[chosen])))


def symmetric(matrices: FloatArray) -> FloatArray:
    """Symmetrise a stack of matrices.

    Parameters
    ----------
    matrices : ndarray, shape (q, n, n)
        The matrices.

    Returns
    -------
    ndarray, shape (q, n, n)
        Means of each and its transpose.
    """
    return np.asarray((matrices + matrices.transpose(0, 2, 1)) / 2.0)


def chosen(block: Block, designs: Sequence[Sizes], missed: float) -> list[Sizes]:
    """Choose designs that hold the motions of all, the worst next (a greedy search).

    It begins with the first design. It ends when no motion of unit strain energy of any design has more than `missed`
    of that energy outside the span of those chosen.

    Parameters
    ----------
    block : Block
        The class, on a coarse mesh.
    designs : sequence of (float, float, float, float)
        Thickness, height, side and pitch in m of each design.
    missed : float
        Fraction of a motion's energy.

    Returns
    -------
    list of (float, float, float, float)
        The chosen ones, in m.
    """
    left = dict(zip(designs, _motions(block, designs), strict=True))
    taken: list[Sizes] = []
    worst = designs[0]
    while left:
        taken.append(worst)
        span = _span(left.pop(worst))
        left = {sizes: motions - span @ (span.T @ motions) for sizes, motions in left.items()}
        energy = {sizes: float(np.einsum("ij,ij->j", motions, motions).max()) for sizes, motions in left.items()}
        worst = max(energy, key=lambda sizes: energy[sizes], default=worst)
        if energy.get(worst, 0.0) <= missed:
            break
    return taken


def _twice(members: tuple[Member, ...]) -> tuple[Member, ...]:
    """The classes of both panels, which a mirror leaves where they are."""
    return members + tuple((number + len(QUARTERS), factor) for number, factor in members)


STAGGERED = Symmetry(
    2 * QUARTERS,
    2 * QUARTERS,
    {name: (_twice(even), _twice(odd)) for name, (even, odd) in LINES.items()}
    | {INSIDE: (_twice(tuple((number, 1.0) for number in range(len(QUARTERS)))), ())},
)  # the zone's oblique sides are left alone by no mirror


def _symmetry_of(lattice: Lattice, is_alike: bool) -> Symmetry:
    """The symmetry of rows in line whose cell is, or is not, its own image with x and y exchanged, or of staggered rows."""
    return STAGGERED if lattice.is_centred else ALIKE if is_alike else UNLIKE


def _line_of(fraction: FloatArray, lattice: Lattice, symmetry: Symmetry) -> str:
    """The line of the zone that a wavevector in units of pi / pitch lies on and that a mirror leaves alone, by its ends.

    SolverError for any other wavevector of rows in line: paths run along the sides of the irreducible Brillouin zone.
    """
    (x, y), (end_x, end_y) = np.round(fraction, 12), np.round(np.diag(lattice.reciprocal_per_m) / (2.0 * np.pi), 12)
    end_x = end_x * (1 + lattice.is_centred)
    on = {"GX": y == 0.0, "XM": x == end_x, "GM": x == y, "YM": y == end_y, "GY": x == 0.0, INSIDE: True}
    for name, is_on in on.items():
        if is_on and name in symmetry.sectors:
            return name
    raise SolverError(f"wavevector {x:g}, {y:g} pi/pitch: no mirror of the cell leaves it alone")


def _parities(face: Interface, symmetry: Symmetry) -> tuple[FloatArray, ...]:
    """Each member's polynomials among the cell's own, (boundary, m); the image of a class by exchanging x and y."""
    own = [face.parity_basis({0: x, 1: y}, diagonal) for x, y, diagonal in symmetry.classes]
    images = len(symmetry.members) - len(symmetry.classes)
    return (*own, *(one[face.diagonal()] for one in own[len(own) - images :]))


def sectors(
    face: Interface,
    fractions: Sequence[Sequence[float]] | FloatArray,
    lattice: Lattice = IN_LINE,
    is_alike: bool = True,
) -> tuple[Sector, ...]:
    """Build every sector of a path's wavevectors.

    Parameters
    ----------
    face : Interface
        Degrees along the sides and through the thickness.
    fractions : array_like, shape (k, 2)
        Wavevectors in units of pi / pitch.
    lattice : Lattice, optional
        The lattice of the rows.
    is_alike : bool, optional
        Whether the cell is its own image with x and y exchanged.

    Returns
    -------
    tuple of Sector
        Wavevectors and boundary motions.

    Raises
    ------
    SolverError
        For a wavevector of rows in line that none of the cell's mirrors leaves alone.
    """
    return _sectors(face, tuple((float(x), float(y)) for x, y in fractions), lattice, is_alike)


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


def _at(places: sp.csc_array, values: FloatArray) -> sp.csc_array:
    return sp.csc_array((values[places.data], places.indices, places.indptr), shape=places.shape)


def _clamped_modes(mass: sp.csc_array, factor: Factor, count: int) -> FloatArray:
    """The lowest modes, with unit strain energy: functions for a basis, so they need not be complete."""
    pairs = block_lanczos(factor.solve, lambda block: np.asarray(mass @ block), mass.shape[0], count, ROUGH)
    if pairs is None:
        raise SolverError("the clamped modes of a cell's inside did not converge")
    inverse, vectors = pairs
    return np.asarray(vectors * np.sqrt(inverse))


def _block(
    block: Block,
    inner: FloatArray,
    stiffness: Iterable[sp.csc_array],
    mass: Iterable[sp.csc_array],
    exponents: tuple[IntArray, IntArray],
) -> ReducedBlock:
    whole = np.zeros((block.forms.dof, block.functions.shape[1] + inner.shape[1]))
    whole[block.on_boundary, : block.functions.shape[1]] = block.functions
    whole[block.inner, block.functions.shape[1] :] = inner
    nodal = np.asarray(block.forms.fold @ whole)
    rule = face_quadrature(block.cell.mesh, "touch")
    return ReducedBlock(
        np.array(block.signs),
        block.functions.shape[1],
        symmetric(np.array([whole.T @ (one @ whole) for one in stiffness])),
        symmetric(np.array([whole.T @ (one @ whole) for one in mass])),
        np.asarray(rule.interpolation @ nodal[2::3]),
        block.shares,
        np.array([block.functions.T @ block.traces(block.of_share(share)) for share in block.shares]),
        block.parity,
        *exponents,
    )


def _motions(block: Block, designs: Sequence[Sizes]) -> list[FloatArray]:
    """What the inside does at each design, in coordinates in which the strain energy of the reference design is the length;
    rigid-body modes, which every basis has, taken out.
    """
    stiffness, _ = block.stretched(block.cell.reference)
    root = np.linalg.cholesky(stiffness[block.inner][:, block.inner].toarray()).T
    still = _span(root @ np.hstack([block.rigid(sizes) for sizes in designs]))
    out = []
    for sizes in designs:
        motions = root @ np.hstack(block.inner_shapes(sizes, ASKED))
        out.append(motions - still @ (still.T @ motions))
    return out


def _span(motions: FloatArray) -> FloatArray:
    left, size, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(left[:, size > 1e-9 * size[0]])


@lru_cache(maxsize=8)
def _sectors(
    face: Interface, fractions: tuple[tuple[float, float], ...], lattice: Lattice, is_alike: bool
) -> tuple[Sector, ...]:
    symmetry = _symmetry_of(lattice, is_alike)
    lines = np.array([_line_of(np.array(fraction), lattice, symmetry) for fraction in fractions])
    classes, out = _parities(face, symmetry), []
    for name, pair in symmetry.sectors.items():
        points = np.flatnonzero(lines == name)
        phases = [lattice.phases(np.pi * np.array(fractions[point])) for point in points]
        for members in pair:
            bases = [_basis(face, symmetry, classes, members, phase) for phase in phases if members]
            if bases:
                out.append(Sector(points, _stored(members, symmetry), np.array(bases)))
    return tuple(out)


def _stored(members: tuple[Member, ...], symmetry: Symmetry) -> tuple[int, ...]:
    """The reduced blocks behind a sector: (-, +) is (+, -) turned over, and both tied by the diagonal are one."""
    numbers = [min(number, len(symmetry.classes) - 1) for number, _ in members]
    return tuple(dict.fromkeys(numbers))


def _basis(
    face: Interface, symmetry: Symmetry, classes: tuple[FloatArray, ...], members: tuple[Member, ...], phase: FloatArray
) -> FloatArray:
    """An orthonormal real basis of the boundary motions that keep Bloch's condition in a sector, (rows, m).

    phase (2,): of the lattice vectors.
    """
    count = 1 + (symmetry is STAGGERED)
    panels = np.split(Ties(face, [0] * count, count - 1).closed(phase), count)
    pieces: dict[int, ComplexArray] = {}
    for number, factor in members:
        panel = number // len(QUARTERS) if count > 1 else 0
        turn = np.exp(-1j * phase[0] * panel / count)
        # a class odd under the half turn has imaginary coordinates: times -i they are real
        turn = turn * (1.0 if symmetry.members[number][0] == symmetry.members[number][1] else -1j)
        stored = min(number, len(symmetry.classes) - 1)
        pieces[stored] = pieces.get(stored, 0.0) + factor * turn * (classes[number].T @ panels[panel])
    whole = np.vstack(list(pieces.values()))
    return _range(np.hstack([whole.real, whole.imag]), apart=count > 1)


def _range(whole: FloatArray, apart: bool) -> FloatArray:
    """An orthonormal basis of a matrix's range; apart: of each set of rows that no column ties to others, mostly zeros."""
    moved = np.where(np.abs(whole) > RANK, 1.0, 0.0) if apart else np.ones_like(whole)
    count, label = connected_components(csr_array(moved @ moved.T))
    found = []
    for rows in (np.flatnonzero(label == number) for number in range(count)):
        left, size, _ = np.linalg.svd(whole[rows], full_matrices=False)
        basis = np.zeros((len(whole), len(size)))
        basis[rows] = left
        found.append((basis, size))
    basis, size = np.hstack([each for each, _ in found]), np.concatenate([each for _, each in found])
    return np.asarray(basis[:, size > RANK * size.max()])
