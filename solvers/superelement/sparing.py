"""Boundary functions that bare panels away from feet and supports do without, and what leaving them out costs.

Panels with a foot need functions that vary quickly along their sides and through the thickness. In bare plate waves
are long, and most of these functions do nothing: only those are kept that the Bloch waves of bare panels need.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from solvers.superelement.cell import Cell, PlacedCell
from solvers.superelement.interface import Interface
from solvers.superelement.plate import AssembledPlate

if TYPE_CHECKING:
    from solvers.superelement.lattice import ReducedLattice

DIRECTIONS = 4  # of the half plane, between the axes and the diagonals
LENGTHS = tuple(0.7**step for step in range(8))  # of wavevectors, over the shortest wave's
WAVES = 3  # flexural, shear and longitudinal
STEPS = 4  # from one wavevector to that at which the flexural wave has the frequency sought
HIGHER = 1.5  # times the highest frequency: waves above it do not matter
SHORTEST = 0.9 * np.pi  # phase across a panel beyond which waves of several lengths look alike
RIGID = 1e-11  # of the largest eigenvalue of a panel's stiffness: below it, it moves as a whole


def needed(cells: Iterable[Cell], high_hz: float, error: float) -> BoolArray | None:
    """Choose the boundary functions that waves in bare plate need.

    Functions that differ in direction alone are kept or left out together. Those that change frequencies least are left out,
    as many as change them by less than `error` in all.

    Parameters
    ----------
    cells : iterable of Cell
        Reductions of the bare panels, with the same interface.
    high_hz : float
        Highest frequency of interest in Hz.
    error : float
        Relative change of a frequency.

    Returns
    -------
    ndarray of bool, shape (interface.count,), or None
        True for the functions that are kept; None where a wave is too short for its panel.
    """
    cells = list(cells)
    kinds = kinds_of(cells[0].interface)
    worst = np.zeros(kinds.max() + 1)
    for cell in cells:
        own = _effects(cell, kinds, high_hz)
        if own is None:
            return None
        worst = np.maximum(worst, own)
    order = np.argsort(worst)
    left_out = order[np.cumsum(worst[order]) < error]
    return ~np.isin(kinds, left_out)


def kinds_of(face: Interface) -> IntArray:
    """Number the kinds of boundary functions: by degree along the side, function through the thickness, in or out of plane.

    Parameters
    ----------
    face : Interface
        The boundary functions.

    Returns
    -------
    ndarray of int, shape (face.count,)
        Kind of each.
    """
    out_of_plane = np.arange(face.count) % 3 == 2
    return np.asarray((face.along_side * face.layers + face.across) * 2 + out_of_plane)


def _effects(cell: Cell, kinds: IntArray, high_hz: float) -> FloatArray | None:
    """Largest relative rise of a wave's frequency without each kind of functions, (kinds,)."""
    from solvers.superelement.lattice import ReducedLattice  # other plates have no use for it

    lattice, worst, each = ReducedLattice(cell), np.zeros(kinds.max() + 1), np.unique(kinds)
    for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        direction = np.array([np.cos(angle), np.sin(angle)])
        length = _shortest(lattice, direction, high_hz)
        if length is None:
            return None
        for share in LENGTHS:
            waves = lattice.waves(share * length * direction, WAVES)
            moving = (waves.frequency_hz > 0.0) & (waves.frequency_hz <= HIGHER * high_hz)
            vectors = waves.dofs[:, moving]
            if vectors.size:
                images = cell.stiffness @ vectors, cell.mass @ vectors
                value = np.divide(*(energy(vectors, image) for image in images))
                rises = [rise_without(cell, vectors, np.flatnonzero(kinds == one), images, value).max() for one in each]
                worst[each] = np.maximum(worst[each], rises)
    return worst


def _shortest(lattice: ReducedLattice, direction: FloatArray, high_hz: float) -> float | None:
    """Wavenumber in rad/m at which the lowest wave reaches a frequency; None beyond a panel's own limit."""
    limit = SHORTEST / float(np.abs(lattice.cell.vectors_m @ direction).max())
    length = limit / 10.0
    for _ in range(STEPS):  # of flexural waves, whose frequency goes as the square of the wavenumber or less
        length *= float(np.sqrt(high_hz / lattice.frequencies(length * direction, 1)[0]))
        if length > limit:
            return None
    return length


class Matrices(Protocol):
    """Something with K and M: a pencil, or a cell."""

    @property
    def stiffness(self) -> Any: ...
    @property
    def mass(self) -> Any: ...


def energy(vectors: FloatArray | ComplexArray, images: FloatArray | ComplexArray) -> FloatArray:
    """Compute u^H v of each pair of columns.

    Parameters
    ----------
    vectors, images : ndarray, shape (n, k)
        u and v.

    Returns
    -------
    ndarray, shape (k,)
        Real parts.
    """
    return np.asarray(np.einsum("ik,ik->k", vectors.conj(), images).real)


def rise_without(
    own: Matrices,
    vectors: FloatArray | ComplexArray,
    where: IntArray,
    images: tuple[FloatArray | ComplexArray, FloatArray | ComplexArray],
    value: FloatArray,
) -> FloatArray:
    """Compute the relative rise of frequencies without the part d of each mode u on some functions.

    By Rayleigh's quotient of u - d, from K and M on d alone.

    Parameters
    ----------
    own : Matrices
        Scaled K and M.
    vectors : ndarray, shape (dof, k)
        Modes or waves u.
    where : ndarray of int, shape (n,)
        The functions.
    images : tuple of ndarray, shape (dof, k)
        K u and M u.
    value : ndarray, shape (k,)
        Scaled eigenvalues of u.

    Returns
    -------
    ndarray, shape (k,)
        Relative, at least 0.
    """
    dropped = vectors[where]
    left = [
        energy(vectors, image)
        - 2.0 * energy(dropped, image[where])
        + energy(dropped, matrix[where][:, where] @ dropped)
        for matrix, image in zip((own.stiffness, own.mass), images, strict=True)
    ]
    return np.asarray(np.sqrt(np.maximum(left[0] / left[1] / value, 1.0)) - 1.0)


def rise(plate: AssembledPlate, value: FloatArray, vectors: FloatArray) -> FloatArray:
    """Bound what a plate's modes lose by the functions left out: r' (S - l M_ee)^-1 r over the modes' 2 l.

    e are the functions left out, c the others, r the modes' residual on e, l the largest eigenvalue, and S = K_ee - K_ec K_cc^+
    K_ce what resists a motion of e that c may follow. Each panel answers its share of r alone. The panels' S together are no
    stiffer than the plate's, so their work is no less than the plate's.

    Parameters
    ----------
    plate : AssembledPlate
        A plate whose bare panels do without some functions.
    value : ndarray, shape (k,)
        Scaled eigenvalues l.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes.

    Returns
    -------
    ndarray, shape (k,)
        Relative errors of the frequencies; infinite where the functions left out have modes of their own below.
    """
    if plate.grid.kept is None or not len(value):
        return np.zeros_like(value)
    parts = list(_left_out(plate))
    count = 1 + max((int(part.at.max()) for part in parts), default=-1)
    force, shared = np.zeros((count, len(value))), np.zeros(count)
    for part in parts:
        motion, cell = plate.cell_vectors(part.placed, vectors), part.placed.cell
        defect = cell.stiffness[part.local] @ motion - (cell.mass[part.local] @ motion) * value
        force[part.at] += part.placed.copies * part.sign[:, None] * defect
        shared[part.at] += part.placed.copies * part.sign**2
    force /= shared[:, None]
    total, factors = np.zeros_like(value), Factors(float(value.max()))
    for part in parts:
        load = part.sign[:, None] * force[part.at]
        try:
            answer = factors.solve(part, load)
        except LinAlgError:
            return np.full_like(value, np.inf)
        total += part.placed.copies * np.einsum("nk,nk->k", load, answer)
    return np.asarray(total / (2.0 * value))


@dataclass(frozen=True)
class LeftOut:
    """Functions that a panel does without: `local` (n,) of its cell, places `at` (n,) among all left out, signs there."""

    placed: PlacedCell
    local: IntArray
    at: IntArray
    sign: FloatArray


def _left_out(plate: AssembledPlate) -> Iterator[LeftOut]:
    """What each panel of a class does without."""
    whole = plate.complete
    fresh = np.setdiff1d(whole.origin, plate.origin)
    for one, other in zip(plate.placed_cells, whole.placed_cells, strict=True):
        local = np.flatnonzero((one.coefficient == 0.0) & (other.coefficient != 0.0))
        if len(local):
            yield LeftOut(one, local, np.searchsorted(fresh, whole.origin[other.dofs[local]]), other.coefficient[local])


class Factors:
    """Cholesky factors of S - l M_ee of the functions e that a panel does without, one for all panels alike."""

    def __init__(self, value: float) -> None:
        self.value = value
        self._known: dict[tuple[int, bytes], Any] = {}

    def solve(self, part: LeftOut, load: FloatArray) -> FloatArray:
        """Motion (n, k) under loads (n, k). Raises LinAlgError where the functions have modes below l."""
        key, cell = (id(part.placed.cell), part.local.tobytes()), part.placed.cell
        if key not in self._known:
            others = np.setdiff1d(np.arange(cell.dof), part.local)
            own, between, rest = (
                np.ix_(*pair) for pair in ((part.local, part.local), (others, part.local), (others, others))
            )
            followed = np.linalg.pinv(cell.stiffness[rest], RIGID, hermitian=True) @ cell.stiffness[between]
            resisting = cell.stiffness[own] - cell.stiffness[between].T @ followed
            self._known[key] = cho_factor(resisting - self.value * cell.mass[own])
        return np.asarray(cho_solve(self._known[key], load))
