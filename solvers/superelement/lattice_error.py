"""How far the bands of a reduced cell lie above those of its mesh, estimated from the reduced matrices alone.

Subspaces of the same matrices without the highest bubbles, and without the upper modes, give frequencies from above
(Galerkin). The error by N fixed-interface modes falls as N^-RATE, hence from a rise S without the upper share s of them
E = S / ((1 - s)^-RATE - 1); of several shares the largest counts, since single modes couple more or less. A cell that keeps no
mode gives nothing to extrapolate from: the residual flexibility of its modes tells (`Cell.dropped`). The degree's error falls
exponentially: what the last degree brought bounds what the next ones would.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from solvers.superelement.cell import Cell
from solvers.superelement.lattice import Lattice, Waves

RATE = 1.5  # measured against full cells: square and oblong, 3 to 12 mm, bare, short and tall pillars
SHARES = (1 / 3, 1 / 2, 2 / 3)
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
    modes = 0.0 if len(lattice.cell.fixed_hz) else _without_modes(lattice, wavevectors, count)
    ours = [lattice.frequencies(k, count) for k in wavevectors]
    for share in SHARES if len(lattice.cell.fixed_hz) else ():
        rise = _rise(ours, lattice.truncated(0, share), wavevectors)
        modes = max(modes, rise / ((1.0 - share) ** -RATE - 1.0))
    return ReductionError(modes, _rise(ours, lattice.truncated(1, 0.0), wavevectors))


def last_degree_through(lattice: Lattice, wavevectors: FloatArray, count: int) -> float:
    """Largest relative rise of the `count` lowest bands without the highest functions through the thickness."""
    ours = [lattice.frequencies(k, count) for k in wavevectors]
    return _rise(ours, lattice.truncated(0, 0.0, 1), wavevectors)


def _without_modes(lattice: Lattice, wavevectors: FloatArray, count: int) -> float:
    """Half of l u^H D u over the waves at l, D the residual flexibility of a cell that keeps no fixed-interface mode."""
    lost, worst = lattice.cell.on_boundary(lattice.cell.dropped), 0.0
    for k in wavevectors:
        waves = lattice.waves(k, count)
        energy = np.einsum("in,in->n", waves.dofs.conj(), lost @ waves.dofs).real
        moving = waves.frequency_hz > STILL * waves.frequency_hz[-1]
        rise = 0.5 * waves.eigenvalue * lattice.cell.growth(waves.eigenvalue) * energy
        worst = max(worst, float(rise[moving].max(initial=0.0)))
    return worst


def _rise(ours: list[FloatArray], small: Lattice, wavevectors: FloatArray) -> float:
    """Largest relative rise of the lowest frequencies at wavevectors, a row each, to those of a truncated lattice."""
    worst = 0.0
    for k, known in zip(wavevectors, ours, strict=True):
        theirs = small.frequencies(k, len(known))
        known = known[: len(theirs)]
        moving = known > STILL * known[-1]
        worst = max(worst, float((theirs[moving] / known[moving] - 1.0).max(initial=0.0)))
    return worst


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
