"""How far truncation and mesh may put the bands of a reduced cell off, from the reduced matrices alone.

What the fixed-interface modes left out take is told by their residual flexibility and has bounds (`Waves.by_modes`). A subspace
without the functions D raises an eigenvalue l of the wave u by u_D^H (K - l M)_DD u_D to first order, and the degree's error
falls exponentially: what the last degree along the sides brought bounds what the next ones would, and by how much every second
degree brought less, since a wave may need even or odd ones alone, tells how far they stay below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Lattice, Waves
from solvers.superelement.residual import ResidualModes

HIDDEN, BEYOND = (
    0.3,
    0.02,
)  # of the largest estimate of a band and those below it, of all: one wave may hide what others show
# times the geometric series, of which further degrees brought 0.03 to 2.7 to 48 cells of degrees 5 and 6; and of the last
# degree's part at least, where they bring next to nothing; the fewest degrees that tell it
SERIES, MIN_SHARE, MIN_DEGREE = 3.0, 0.2, 5
LOWEST, TRIALS = 0.3, 40  # cut-offs tried, from this share of the lattice's own on
STILL = 1e-4  # of the highest frequency asked for: slower waves are rigid-body modes but for rounding


@dataclass(frozen=True)
class ReductionError:
    """Relative errors of frequencies: by the modes left out, to either side, and by the degrees along the sides left out."""

    modes: float
    degrees: float

    @property
    def total(self) -> float:
        """Both."""
        return self.modes + self.degrees


@dataclass(frozen=True)
class MeshErrors:
    """Relative, (n,) each: how far the finer mesh's own frequency lies above the reported one, and the half-width of the bar.

    The half-width is NaN where no coarser mesh tells it.
    """

    taken: FloatArray
    half_width: FloatArray


def reduction_error(lattice: Lattice, wavevectors: FloatArray, count: int) -> ReductionError:
    """Estimate for the `count` lowest bands at wavevectors (n, 2) in rad/m: the worst of them."""
    return error_of_waves(lattice, [lattice.waves(k, count) for k in wavevectors])


def error_of_waves(lattice: Lattice, waves: Sequence[Waves]) -> ReductionError:
    """The same of waves that are solved already."""
    estimates = [truncation(lattice, each) for each in waves]
    modes, degrees = (max(float(each.max(initial=0.0)) for each in kind) for kind in zip(*estimates, strict=True))
    return ReductionError(modes, further_degrees(lattice, waves) * degrees)


def truncation(lattice: Lattice, waves: Waves) -> tuple[FloatArray, FloatArray]:
    """What the modes left out may put each wave off by, and what the last degree along the sides brought it, relative, (n,)
    each; 0 for rigid-body waves.
    """
    cell, face = lattice.cell, lattice.cell.interface
    modes = np.where(_moving(waves), waves.by_modes, 0.0)
    return modes, _rise(cell, waves, _beyond(face, Interface(max(face.along - 1, 1), face.through)))


def further_degrees(lattice: Lattice, waves: Sequence[Waves]) -> float:
    """What degrees along the sides beyond the last may bring, of what the last one brought: at most 1.

    Parts R_n of a degree n fall as q^(n/2) with the largest q = R_n / R_(n-2) seen: the next two bring (R_n + R_(n-1)) q.
    A degree below 5 shows no q of even and of odd ones.
    """
    cell, face = lattice.cell, lattice.cell.interface
    if face.along < MIN_DEGREE:
        return 1.0
    degrees = range(face.along - 3, face.along + 1)
    own = {degree: face.within(Interface(degree, face.through)) for degree in (degrees[0] - 1, *degrees)}
    parts = {
        degree: max(_largest_rise(cell, each, np.setdiff1d(own[degree], own[degree - 1])) for each in waves)
        for degree in degrees
    }
    last, falls = parts[degrees[-1]], [parts[n] / parts[n - 2] for n in degrees[2:] if parts[n - 2] > 0.0]
    if not falls or last <= 0.0:
        return 1.0
    return float(min(1.0, max(SERIES * (1.0 + parts[degrees[-2]] / last) * max(falls), MIN_SHARE)))


def _largest_rise(cell: Cell, waves: Waves, functions: IntArray) -> float:
    return float(_rise(cell, waves, functions).max(initial=0.0))


def cutoff_hz(lattice: Lattice, wavevectors: FloatArray, count: int, wanted: float) -> float:
    """The lowest cut-off of fixed-interface modes, Hz, that leaves the `count` lowest bands a half-width of at most `wanted`.

    The lattice's own where none below it does. A mode's part in a wave tells what it would add to the residual flexibility.
    """
    cell, own = lattice.cell, lattice.cell.dropped_hz
    first = cell.interface.count
    stiff, heavy = (np.diag(matrix)[first:, None] for matrix in (cell.stiffness, cell.mass))
    trials = own * np.geomspace(LOWEST, 1.0, TRIALS)
    worst = np.zeros(TRIALS)
    for k in wavevectors:
        waves = lattice.waves(k, count)
        value = np.where(_moving(waves), waves.eigenvalue, np.inf)
        flexible = np.abs(waves.dofs[first:]) ** 2 * (stiff / value - heavy) ** 2 / stiff
        left = np.einsum("in,in->n", waves.dofs[:first].conj(), cell.dropped @ waves.dofs[:first]).real
        for index, top in enumerate(trials):
            lost = left + flexible[cell.fixed_hz > top].sum(axis=0)
            modes = ResidualModes(cell.scale.eigenvalue(top))
            eigenvalue = np.where(np.isinf(value), 0.0, value)
            bars = modes.bar(eigenvalue, eigenvalue + modes.softening(eigenvalue) * lost, lost)
            worst[index] = max(worst[index], float(bars.max()))
    enough = np.flatnonzero(worst <= wanted)
    return float(trials[enough[0]]) if len(enough) else own


def truncation_bars(rises: FloatArray, share: float = 1.0) -> FloatArray:
    """Half-widths of bars by truncation from the estimates of waves (wavevectors, bands), of the same shape; share: of them.

    What waves of the same band or of one below it show, another one may hide; none is off by more than the worst of all.
    """
    worst = rises.max(initial=0.0)
    below = np.maximum.accumulate(rises.max(axis=0, initial=0.0))
    return np.minimum(share * (rises + HIDDEN * below) + BEYOND * worst, share * worst)


def last_degree_through(lattice: Lattice, wavevectors: FloatArray, count: int) -> float:
    """Largest relative rise of the `count` lowest bands without the highest functions through the thickness."""
    face = lattice.cell.interface
    highest = _beyond(face, Interface(face.along, max(face.through - 1, 1)))
    rises = [_rise(lattice.cell, lattice.waves(k, count), highest) for k in wavevectors]
    return max(float(each.max(initial=0.0)) for each in rises)


def _beyond(face: Interface, lower: Interface) -> IntArray:
    """Boundary functions of higher degrees than those of a lower interface."""
    return np.setdiff1d(np.arange(face.count), face.within(lower))


def _rise(cell: Cell, waves: Waves, functions: IntArray) -> FloatArray:
    """Relative rise of each frequency without some of the cell's functions, (n,), to first order."""
    own, square = waves.dofs[functions], np.ix_(functions, functions)
    stiff, heavy = (
        np.einsum("in,in->n", own.conj(), matrix[square] @ own).real for matrix in (cell.stiffness, cell.mass)
    )
    return _relative(stiff - waves.eigenvalue * heavy, waves)


def _relative(raised: FloatArray, waves: Waves) -> FloatArray:
    """Half of what eigenvalues are raised by over themselves; 0 for rigid-body waves."""
    moving = _moving(waves)
    return np.where(moving, np.maximum(raised, 0.0) / (2.0 * np.where(moving, waves.eigenvalue, 1.0)), 0.0)


def _moving(waves: Waves) -> BoolArray:
    """Which are no rigid-body waves, (n,)."""
    return np.asarray(waves.frequency_hz > STILL * waves.frequency_hz[-1])


def mesh_error(cell: Cell, waves: Waves) -> MeshErrors:
    """How far the mesh may put each wave's frequency off; 0 for rigid-body waves.

    By Rayleigh's quotients with what coarser meshes change the cell by (`MeshError.changes`); what lower waves at the same
    wavevector show of short ones, one to which the last order brought nothing may hide (`Shares.of_modes`).
    """
    error = cell.mesh_error
    if error is None:
        return MeshErrors(np.zeros(len(waves.eigenvalue)), np.full(len(waves.eigenvalue), np.nan))
    moving = _moving(waves)
    changes = error.changes(waves.dofs, np.where(moving, waves.eigenvalue, 1.0))
    layer, order = (np.where(moving, change, 0.0) for change in changes)
    return MeshErrors(error.taken * layer, error.shares.of_modes(waves.eigenvalue, layer, order))
