"""How far the bands of a reduced cell lie above those of its mesh, estimated from the reduced matrices alone.

A subspace without the functions D raises an eigenvalue l of the wave u by u_D^H (K - l M)_DD u_D to first order. The error by N
fixed-interface modes falls as N^-RATE, hence from a rise S without the upper share s of them E = S / ((1 - s)^-RATE - 1); of
several shares the largest counts, since single modes couple more or less. A cell that keeps no mode gives nothing to
extrapolate from: the residual flexibility of its modes tells (`Cell.dropped`). The degree's error falls exponentially: what the
last degree brought bounds what the next ones would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray, IntArray
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Lattice, Waves

RATE = 1.5  # measured against full cells: square and oblong, 3 to 12 mm, bare, short and tall pillars
SHARES = (1 / 3, 1 / 2, 2 / 3)
HIDDEN, BEYOND = (
    0.3,
    0.02,
)  # of the largest estimate of a band and those below it, of all: one wave may hide what others show
STILL = 1e-4  # of the highest frequency asked for: slower waves are rigid-body modes but for rounding


@dataclass(frozen=True)
class ReductionError:
    """Relative errors of frequencies, from above, by the modes left out and by the degrees along the sides left out."""

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
    told = [truncation(lattice, lattice.waves(k, count)) for k in wavevectors]
    return ReductionError(*(max(float(each.max(initial=0.0)) for each in kind) for kind in zip(*told, strict=True)))


def truncation(lattice: Lattice, waves: Waves) -> tuple[FloatArray, FloatArray]:
    """Relative rise of each wave by the modes left out and by the degrees along the sides left out, (n,) each."""
    cell = lattice.cell
    modes = _by_modes(cell, waves) if len(cell.fixed_hz) else _without_modes(cell, waves)
    face = cell.interface
    return modes, _rise(cell, waves, _beyond(face, Interface(max(face.along - 1, 1), face.through)))


def truncation_bars(rises: FloatArray) -> FloatArray:
    """Half-widths of bars by truncation from the estimates of waves (wavevectors, bands), of the same shape.

    What waves of the same band or of one below it show, another one may hide; none is off by more than the worst of all.
    """
    worst = rises.max(initial=0.0)
    below = np.maximum.accumulate(rises.max(axis=0, initial=0.0))
    return np.minimum(rises + HIDDEN * below + BEYOND * worst, worst)


def last_degree_through(lattice: Lattice, wavevectors: FloatArray, count: int) -> float:
    """Largest relative rise of the `count` lowest bands without the highest functions through the thickness."""
    face = lattice.cell.interface
    highest = _beyond(face, Interface(face.along, max(face.through - 1, 1)))
    rises = [_rise(lattice.cell, lattice.waves(k, count), highest) for k in wavevectors]
    return max(float(each.max(initial=0.0)) for each in rises)


def _beyond(face: Interface, lower: Interface) -> IntArray:
    """Boundary functions of higher degrees than those of a lower interface."""
    return np.setdiff1d(np.arange(face.count), face.within(lower))


def _by_modes(cell: Cell, waves: Waves) -> FloatArray:
    """Of a cell that keeps fixed-interface modes, from what each of them takes part."""
    first, order = cell.interface.count, np.argsort(-cell.fixed_hz, kind="stable")
    stiff, heavy = (np.diag(matrix)[first:, None] for matrix in (cell.stiffness, cell.mass))
    energy = (stiff - waves.eigenvalue * heavy) * np.abs(waves.dofs[first:]) ** 2
    highest = np.cumsum(energy[order], axis=0)  # without the highest, the two highest ...
    rises = [
        _relative(highest[int(np.ceil(share * len(order))) - 1], waves) / ((1.0 - share) ** -RATE - 1.0)
        for share in SHARES
    ]
    return np.asarray(np.max(rises, axis=0))


def _rise(cell: Cell, waves: Waves, functions: IntArray) -> FloatArray:
    """Relative rise of each frequency without some of the cell's functions, (n,), to first order."""
    own, square = waves.dofs[functions], np.ix_(functions, functions)
    stiff, heavy = (
        np.einsum("in,in->n", own.conj(), matrix[square] @ own).real for matrix in (cell.stiffness, cell.mass)
    )
    return _relative(stiff - waves.eigenvalue * heavy, waves)


def _relative(raised: FloatArray, waves: Waves) -> FloatArray:
    """Half of what eigenvalues are raised by over themselves; 0 for rigid-body waves."""
    moving = waves.frequency_hz > STILL * waves.frequency_hz[-1]
    return np.where(moving, np.maximum(raised, 0.0) / (2.0 * np.where(moving, waves.eigenvalue, 1.0)), 0.0)


def _without_modes(cell: Cell, waves: Waves) -> FloatArray:
    """l u^H D u over the waves at l, D the residual flexibility of a cell that keeps no fixed-interface mode."""
    lost = cell.on_boundary(cell.dropped)
    energy = np.einsum("in,in->n", waves.dofs.conj(), lost @ waves.dofs).real
    return _relative(waves.eigenvalue**2 * cell.growth(waves.eigenvalue) * energy, waves)


def mesh_error(cell: Cell, waves: Waves) -> MeshErrors:
    """How far the mesh may put each wave's frequency off; 0 for rigid-body waves.

    By Rayleigh's quotients with what coarser meshes change the cell by (`MeshError.changes`).
    """
    error = cell.mesh_error
    if error is None:
        return MeshErrors(np.zeros(len(waves.eigenvalue)), np.full(len(waves.eigenvalue), np.nan))
    moving = waves.frequency_hz > STILL * waves.frequency_hz[-1]
    changes = error.changes(waves.dofs, np.where(moving, waves.eigenvalue, 1.0))
    layer, order = (np.where(moving, change, 0.0) for change in changes)
    return MeshErrors(error.taken * layer, error.shares.half_width(layer, order))
