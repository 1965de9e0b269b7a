"""Waves followed along a path through their crossings and labelled: polarisation, and parity under mirrors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.lattice import MIRRORS
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Periodic, ReducedLattice, Waves, degenerate, times

# -- branches ----------------------------------------------------------------------------------------------------------
# Waves followed along a path through their crossings, by the modal overlap of their shapes.
# The modal overlap of two waves is the modal assurance criterion |u^H M v|^2 of their fields on one and the same cell
# (allemang2003); there the phases exp(i k.r) of neighbouring wavevectors differ little, and the global phase drops
# out. Degenerate waves are first turned into those that continue to each side: eigenvectors of d lambda / d k along
# the step within their group.

CLEAR = 0.5  # modal overlap from which a wave is followed without halving the step
LOST = 0.1  # below it a wave is another one
DEEPEST = 4  # halvings of a step
EXTRA = 4  # waves followed above the requested ones, so that a branch may come down
PARTNERS = 2  # waves solved above these, so that each is followed with its degenerate partner
TIED = 0.01  # of modal overlap: waves within this tolerance are equally similar and keep their order


class Solved:
    """The waves of a lattice, each wavevector solved once: `count` requested, some above and their degenerate partners."""

    def __init__(self, lattice: ReducedLattice, count: int) -> None:
        self.lattice, self.count = lattice, min(count, lattice.dof)
        self._known: dict[tuple[float, float], Waves] = {}

    def __call__(self, wavevector: FloatArray) -> Waves:
        """Waves at a wavevector (2,) in rad/m."""
        key = (float(wavevector[0]), float(wavevector[1]))
        if key not in self._known:
            self._known[key] = self.lattice.waves(np.array(key), self.count + EXTRA + PARTNERS)
        return self._known[key]

    def turned(self, wavevector: FloatArray, direction: FloatArray, neighbour: Waves) -> Waves:
        """The waves to follow at a wavevector, degenerate ones turned with all of their partners."""
        waves, kept = turned(self.lattice, self(wavevector), direction, neighbour), self.count + EXTRA
        return replace(
            waves,
            eigenvalue=waves.eigenvalue[:kept],
            frequency_hz=waves.frequency_hz[:kept],
            dofs=waves.dofs[:, :kept],
            by_modes=waves.by_modes[:kept],
        )


@dataclass(frozen=True)
class Branches:
    """Waves at each wavevector, degenerate ones turned, and the number (wavevectors, waves) of each one's branch, from 1."""

    waves: tuple[Waves, ...]
    number: IntArray


def follow(solved: Solved, wavevectors: FloatArray) -> Branches:
    """Number the waves at successive wavevectors so that a branch keeps its number across crossings.

    A branch that leaves the waves computed loses its number, one that enters gets a new one.

    Parameters
    ----------
    solved : Solved
        Waves of the lattice; further wavevectors are solved where a step must be halved.
    wavevectors : ndarray, shape (n, 2)
        Path in rad/m, at least two different wavevectors.

    Returns
    -------
    Branches
        Waves at each wavevector, some more than `solved.count`, and their branch numbers.
    """
    lattice = solved.lattice
    kept: list[Waves] = []
    numbers: list[IntArray] = []
    for here, there in pairwise(wavevectors):
        start = solved.turned(here, there - here, solved(there))
        if not kept:
            kept, numbers = [start], [np.arange(1, len(start.eigenvalue) + 1, dtype=np.int64)]
        leaving = numbers[-1][_through(modal_overlap(lattice, kept[-1], start)).argsort()]
        partner, likely = _step(solved, start, there, DEEPEST)
        new = 1 + max(int(number.max()) for number in numbers)
        arriving = np.empty_like(leaving)
        arriving[partner] = np.where(likely >= LOST, leaving, new + np.arange(len(leaving)))
        kept.append(solved.turned(there, there - here, start))
        numbers.append(arriving)
    return Branches(tuple(kept), _dense(numbers))


def modal_overlap(lattice: ReducedLattice, one: Waves, two: Waves) -> FloatArray:
    """Compute the modal assurance criterion |u_i^H M v_j|^2 of waves on the cell.

    Parameters
    ----------
    lattice : ReducedLattice
        Lattice of the waves.
    one, two : Waves
        Waves at two wavevectors, n and m.

    Returns
    -------
    ndarray, shape (n, m)
        1 for equal waves, 0 for M-orthogonal ones.

    References
    ----------
    .. [1] allemang2003 (docs/references.bib)
    """
    return np.asarray(np.abs(one.dofs.conj().T @ times(lattice.cell.mass, two.dofs)) ** 2)


def one_sided(lattice: ReducedLattice, waves: Waves, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute slopes d lambda / d s of the sorted bands along a direction, beyond the wavevector and before it.

    Parameters
    ----------
    lattice : ReducedLattice
        Lattice of the waves.
    waves : Waves
        Waves at the wavevector.
    direction : ndarray, shape (2,)
        Change of the wavevector in rad/m per unit of s; its length scales the slopes.

    Returns
    -------
    beyond, before : ndarray, shape (n,)
        Slopes of scaled eigenvalues towards larger and from smaller s, which differ where bands cross.
    """
    slope = np.tensordot(direction, lattice.slopes(waves), axes=1)
    beyond, before = np.empty(len(slope)), np.empty(len(slope))
    for group in degenerate(waves.eigenvalue, lattice.rounding):
        beyond[group] = np.linalg.eigvalsh(slope[group, group])
        before[group] = beyond[group][::-1]
    return beyond, before


def turned(lattice: ReducedLattice, waves: Waves, direction: FloatArray, neighbour: Waves) -> Waves:
    """Turn degenerate waves into those with a slope each along a direction.

    Those with equal slopes turn towards the neighbour's waves.

    Parameters
    ----------
    lattice : ReducedLattice
        Lattice of the waves.
    waves : Waves
        Waves at the wavevector.
    direction : ndarray, shape (2,)
        Direction in the plane of wavevectors, of any length above 0.
    neighbour : Waves
        Waves at a wavevector near by along the direction, on either side.

    Returns
    -------
    Waves
        Waves with the same eigenvalues; the same object if none are degenerate.
    """
    several = [group for group in degenerate(waves.eigenvalue, lattice.rounding) if group.stop - group.start > 1]
    if not several:
        return waves
    dofs = waves.dofs.copy()
    slope = np.tensordot(np.asarray(direction) / np.linalg.norm(direction), lattice.slopes(waves), axes=1)
    close = 1e-6 * np.abs(slope).max()
    for group in several:
        values, vectors = np.linalg.eigh(slope[group, group])
        dofs[:, group] = dofs[:, group] @ vectors
        bounds = [0, *(np.flatnonzero(np.diff(values) > close) + 1), len(values)]
        for low, high in pairwise(bounds):
            if high - low > 1:
                part = slice(group.start + low, group.start + high)
                dofs[:, part] = _aligned(lattice, dofs[:, part], neighbour.dofs)
    return replace(waves, dofs=dofs)


def _aligned(lattice: ReducedLattice, waves: ComplexArray, neighbour: ComplexArray) -> ComplexArray:
    """The waves turned among themselves to be likest those of the neighbour's that lie most in their span (Procrustes)."""
    overlap = neighbour.conj().T @ (lattice.cell.mass @ waves)
    nearest = np.sort(np.argsort(-np.linalg.norm(overlap, axis=1), kind="stable")[: waves.shape[1]])
    left, _, right = np.linalg.svd(overlap[nearest])
    return np.asarray(waves @ (right.conj().T @ left.conj().T))


def _partner(like: FloatArray) -> IntArray:
    """Column assigned to each row so that the sum of the likenesses is largest."""
    # no entry is 0, which would remove the edge; scipy.optimize has the same, but is slow to import
    _, column = min_weight_full_bipartite_matching(sp.csr_array(1.0 + like), maximize=True)
    return np.asarray(column, dtype=np.int64)


def _through(like: FloatArray) -> IntArray:
    """Partners at one wavevector, from the waves of the previous step to those of the next.

    Where the path turns, degenerate waves may be equally alike: they go on in their order.
    """
    return _partner(like + TIED * np.eye(len(like)))


def _step(solved: Solved, start: Waves, end: FloatArray, halvings: int) -> tuple[IntArray, FloatArray]:
    """Partner at the end of each wave at the start, and their likeness, with halved steps where that is unclear."""
    lattice, step = solved.lattice, end - start.wavevector
    there = solved.turned(end, step, start)
    like = modal_overlap(lattice, start, there)
    partner = _partner(like)
    matched = like[np.arange(len(partner)), partner]
    if halvings == 0 or matched[: solved.count].min() >= CLEAR:
        return partner, matched
    middle = solved.turned(start.wavevector + step / 2.0, step, start)
    first, near = _step(solved, start, middle.wavevector, halvings - 1)
    second, far = _step(solved, middle, end, halvings - 1)
    return second[first], np.minimum(near, far[first])


def _dense(numbers: Sequence[IntArray]) -> IntArray:
    """Branch numbers without holes, in the order of their first appearance."""
    flat = np.concatenate(numbers)
    seen, first, where = np.unique(flat, return_index=True, return_inverse=True)
    rank = np.empty(len(seen), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(1, len(seen) + 1)
    return np.asarray(rank[where].reshape(len(numbers), -1))


# -- polarisation ------------------------------------------------------------------------------------------------------
# Polarisation of a plate wave: flexural, shear or longitudinal, and its share in the pillar.
# Along the cell's boundary lines the Legendre layer 0 is the mean through the thickness. Flexural waves carry it in
# u_z; in-plane ones are compared with plane waves along k + G, u || k + G (longitudinal) and u perpendicular to it
# (shear), so that a label does not depend on which of the equivalent wavevectors names the wave.

NAMES = ("flexural", "shear", "longitudinal", "pillar")
HALF = 0.5
FELT = 0.25  # share of u_z in the square: its rms is half of the whole motion's, which a finger notices
EQUAL_PARTS = 1e-6  # relative: what symmetry makes equal; equal parts of both count as shear
FOLDS = 2  # reciprocal vectors tried along each axis: -2 to 2


@dataclass(frozen=True)
class Label:
    """A wave's polarisation: `plate` is that of the plate, `name` is "pillar" instead where asked and mostly there.

    flexural_share: of u_z in the mean square of the thickness-mean motion on the boundary lines; longitudinal_share:
    of the in-plane motion; pillar_share: of the kinetic energy.
    """

    name: str
    plate: str
    flexural_share: float
    longitudinal_share: float
    pillar_share: float


def label_of(
    cells: Cell | Periodic, dofs: ComplexArray, wavevector: ComplexArray, with_pillars: bool = False
) -> list[Label]:
    """Label waves by their polarisation.

    Let u be the mean through the thickness and <> the mean along the boundary lines. Flexural: <|u_z|^2> above a quarter
    of <|u|^2>, since pillars on one face mix in-plane motion into every wave. Else longitudinal when the plane wave
    exp(i (k + G).r) that u resembles most has u || k + G, else shear.

    Parameters
    ----------
    cells : Cell or Periodic
        Cells of one lattice period.
    dofs : ndarray, shape (dof, n)
        The cells' degrees of freedom in each wave.
    wavevector : ndarray, shape (2, n)
        Wavevectors in rad/m, complex where waves decay; at k = 0 a short vector for the direction meant.
    with_pillars : bool, optional
        Name a wave "pillar" where the pillar has over half of the kinetic energy.

    Returns
    -------
    list of Label
        One label per wave, with its shares.
    """
    of = cells if isinstance(cells, Periodic) else Periodic([cells])
    points, weights, motion = _line_motion(of, dofs)
    flexural = _flexural(weights, motion)
    longitudinal = _longitudinal(of, points, weights[:, None, None] * motion[:, :2], weights, np.asarray(wavevector))
    pillar = pillar_share(of, dofs)
    return [
        _label(float(out), float(along), float(moving), with_pillars)
        for out, along, moving in zip(flexural, longitudinal, pillar, strict=True)
    ]


def is_flexural(cells: Periodic, dofs: ComplexArray) -> BoolArray:
    """Mask of the waves that `label_of` calls flexural.

    Parameters
    ----------
    cells : Periodic
        Cells of one lattice period.
    dofs : ndarray, shape (dof, n)
        The cells' degrees of freedom in each wave.

    Returns
    -------
    ndarray, shape (n,)
        True where u_z has over a quarter of the mean square of the thickness-mean motion on the boundary lines.
    """
    _, weights, motion = _line_motion(cells, dofs)
    return np.asarray(_flexural(weights, motion) > FELT)


def _flexural(weights: FloatArray, motion: ComplexArray) -> FloatArray:
    square = np.einsum("p,pck->ck", weights, np.abs(motion) ** 2)
    return np.asarray(square[2] / np.maximum(square.sum(axis=0), np.finfo(float).tiny))


def pillar_share(cells: Periodic, dofs: ComplexArray) -> FloatArray:
    """Compute the pillars' share of the kinetic energy, u^H M_pillar u / u^H M u.

    Parameters
    ----------
    cells : Periodic
        Cells of one lattice period.
    dofs : ndarray, shape (dof, n)
        The cells' degrees of freedom in each wave, of any size.

    Returns
    -------
    ndarray, shape (n,)
        Shares from 0 to 1.
    """
    part, whole = (
        sum(np.einsum("ik,ik->k", own.conj(), getattr(cell, name) @ own).real for cell, own in cells.parts(dofs))
        for name in ("pillar_mass", "mass")
    )
    return np.asarray(np.clip(part / whole, 0.0, 1.0))


def _label(flexural: float, longitudinal: float, pillar: float, with_pillars: bool) -> Label:
    in_plane = "longitudinal" if longitudinal > HALF + EQUAL_PARTS else "shear"
    plate = "flexural" if flexural > FELT else in_plane
    return Label("pillar" if with_pillars and pillar > HALF else plate, plate, flexural, longitudinal, pillar)


def _line_motion(cells: Periodic, dofs: ComplexArray) -> tuple[FloatArray, FloatArray, ComplexArray]:
    """Quadrature points (points, 2) in m on the sides of the cells, their weights (sum 1), thickness means (points, 3, n)."""
    points, weights, motion = [], [], []
    for (cell, own), middle_m in zip(cells.parts(dofs), cells.middles_m, strict=True):
        face = cell.interface
        place, weight, values = _lines(face, cell.size_m[:2])
        if cell.edges_m is not None:
            place = place / np.array(cell.size_m[:2]) @ cell.edges_m
        layer = own[: face.count].reshape(-1, 3, own.shape[1])[:: face.layers]
        points.append(place + np.array([middle_m, 0.0]))
        weights.append(weight / len(cells.cells))
        motion.append(np.tensordot(values, layer, axes=1))
    return np.concatenate(points), np.concatenate(weights), np.concatenate(motion)


def line_gram(face: Interface, size: tuple[float, float] = (1.0, 1.0)) -> FloatArray:
    """Average the products of boundary functions of layer 0 along the sides of a cell.

    Parameters
    ----------
    face : Interface
        Degrees of the boundary functions.
    size : tuple of float, optional
        Edges of the cell along x and y; their ratio alone matters.

    Returns
    -------
    ndarray, shape (m, m)
        Means of products of the m = count / (3 layers) scalar functions.
    """
    _, weights, values = _lines(face, size)
    return np.asarray(values.T @ (weights[:, None] * values))


@lru_cache(maxsize=8)
def _lines(face: Interface, size_m: tuple[float, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points (p, 2) in m on the sides, weights by length (p,), boundary functions of layer 0 there (p, m)."""
    s, w = np.polynomial.legendre.leggauss(face.along + 6)
    one, zero = np.ones_like(s), np.zeros_like(s)
    sides = [(-one, s, zero), (one, s, zero), (s, -one, zero), (s, one, zero)]
    points = np.concatenate([np.column_stack(side) for side in sides])
    weights = np.repeat(np.array(size_m)[[1, 1, 0, 0]], len(s)) * np.tile(w, 4)
    values = face.evaluate(points)[:, :: face.layers]
    return points[:, :2] * np.array(size_m) / 2.0, weights / weights.sum(), values


def _longitudinal(
    cells: Periodic, points: FloatArray, weighted: ComplexArray, weights: FloatArray, wavevector: ComplexArray
) -> FloatArray:
    """|<l, u>|^2 / (|<l, u>|^2 + |<t, u>|^2) for the k + G that has the plane wave, l or t, that u resembles most, (n,).

    Where several are equally like, as at corners of the Brillouin zone, their squares are added up. weighted (points, 2, n):
    the in-plane motion times its points' weights.
    """
    along, across = (
        overlap.reshape(len(overlap), -1) for overlap in _resemblance(cells, points, weighted, weights, wavevector)
    )
    like = np.maximum(along, across)
    best = like >= (1.0 - EQUAL_PARTS) * like.max(axis=1, keepdims=True)
    along, across = (np.where(best, overlap, 0.0).sum(axis=1) for overlap in (along, across))
    return np.asarray(along / np.maximum(along + across, np.finfo(float).tiny))


def _resemblance(
    cells: Periodic, points: FloatArray, weighted: ComplexArray, weights: FloatArray, wavevector: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """|<w, u>|^2 / <w, w> for plane waves w with u || k + G, and with u perpendicular to it, (n, G) each."""
    fold = np.arange(-FOLDS, FOLDS + 1)
    pairs = np.stack(np.meshgrid(fold, fold, indexing="ij"), axis=-1).reshape(-1, 2)
    reciprocal = pairs @ cells.lattice.reciprocal_per_m
    k = wavevector.T[:, None, :] + reciprocal
    carrier = np.exp(1j * points @ wavevector)  # exp(i k.r), (points, n); exp(i G.r) alone depends on G
    energy = weights @ np.abs(carrier) ** 2
    plane = np.exp(-1j * points @ reciprocal.T)
    x, y = ((carrier.conj() * weighted[:, axis]).T @ plane for axis in (0, 1))
    scale = energy[:, None] * np.maximum((np.abs(k) ** 2).sum(axis=-1), np.finfo(float).tiny)
    along = np.abs(k[..., 0].conj() * x + k[..., 1].conj() * y) ** 2 / scale
    across = np.abs(k[..., 1].conj() * x - k[..., 0].conj() * y) ** 2 / scale
    return np.asarray(along), np.asarray(across)


# -- parity ------------------------------------------------------------------------------------------------------------
# Mirror parity of Bloch waves where the mirror keeps the wavevector, up to a reciprocal vector.

AXES = {"x": 0, "y": 1}
SAME = 1e-9  # relative: sides of a cell that are equal
TOLERANCE = 1e-6  # how far the diagonal mirror may be from orthogonal and from leaving K and M alone
PURE = 0.99  # a wave's |<u, S u>| from which it has a parity


class Mirrors:
    """The mirrors of a cell: x -> -x, y -> -y, and "d", which exchanges x and y."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Mirrors that the cell has. x and y are those it was reduced with; the diagonal one is looked for."""
        if self.cell.edges_m is not None:  # none is known of an oblique cell
            return ()
        flat = [name for name, axis in AXES.items() if self._is_kept(axis)]
        return (*flat, "d") if self._diagonal is not None else tuple(flat)

    def _is_kept(self, axis: int) -> bool:
        """Whether a mirror was used; without fixed-interface modes that have signs, whether K_r is its own image."""
        if len(self.cell.fixed_parity):
            return bool((self.cell.fixed_parity[:, axis] != 0).all())
        where, sign = self.cell.interface.mirror(axis)
        stiffness = self.cell.stiffness
        image = sign[:, None] * stiffness[np.ix_(where, where)] * sign
        return bool(np.abs(image - stiffness).max() <= SAME * np.abs(stiffness).max())

    def keeping(self, wavevector: FloatArray) -> tuple[str, ...]:
        """The mirrors that keep a wavevector (2,) in rad/m up to a reciprocal vector."""
        is_same = Periodic([self.cell]).lattice.is_same
        return tuple(name for name in self.names if is_same(MIRRORS[name] @ wavevector, wavevector))

    def image(self, name: str, dofs: ComplexArray) -> ComplexArray:
        """The mirrored waves, (cell dof, n)."""
        face, out = self.cell.interface, np.empty_like(dofs)
        inner = dofs[face.count :]
        if name == "d":
            assert self._diagonal is not None
            out[: face.count] = dofs[face.diagonal()]
            out[face.count :] = self._diagonal @ inner
        else:
            where, sign = face.mirror(AXES[name])
            out[: face.count] = sign[:, None] * dofs[where]
            out[face.count :] = self.cell.fixed_parity[:, AXES[name], None] * inner
        return out

    def parity(self, name: str, dofs: ComplexArray) -> IntArray:
        """+1 where u_z is even under the mirror, -1 where it is odd, 0 where neither (degenerate waves mixed), (n,)."""
        value = np.einsum("ik,ik->k", dofs.conj(), self.cell.mass @ self.image(name, dofs)).real
        size = np.einsum("ik,ik->k", dofs.conj(), self.cell.mass @ dofs).real
        return np.where(np.abs(value) > PURE * size, np.sign(value), 0.0).astype(np.int64)

    @cached_property
    def _diagonal(self) -> FloatArray | None:
        """Action of the diagonal mirror on the fixed-interface modes, from their coupling C to the boundary: C R = P C."""
        cell, count = self.cell, self.cell.interface.count
        if not np.isclose(*cell.size_m[:2], rtol=SAME, atol=0.0):
            return None
        where = cell.interface.diagonal()
        coupling = cell.mass[:count, count:]
        exchange = np.linalg.lstsq(coupling, coupling[where], rcond=None)[0]
        modes = cell.stiffness[count:, count:]
        checks = [
            (exchange.T @ exchange, np.eye(len(exchange))),
            (exchange.T @ modes @ exchange, modes),
            (coupling @ exchange, coupling[where]),
        ]
        for matrix in (cell.stiffness, cell.mass):
            edge = matrix[:count, :count]
            checks.append((edge[np.ix_(where, where)], edge))
        holds = all(
            np.abs(one - two).max(initial=0.0) <= TOLERANCE * np.abs(two).max(initial=1.0) for one, two in checks
        )
        return np.asarray(exchange) if holds else None
