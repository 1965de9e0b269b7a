"""How far truncation and mesh may put the bands of a reduced cell off, from the reduced matrices alone.

What the fixed-interface modes left out take is told by their residual flexibility and has bounds (`Waves.by_modes`). Without
the boundary functions D a wave u of the eigenvalue l rises by at most u_D^H S u_D, S the Schur complement of K + s M on D: the
other functions come to rest, s M holds rigid motion. By Cholesky's factor L of the functions in the order of their degree it
parts into |L^H u|^2, degree by degree. The degree's error falls exponentially: what the last degree along the sides brought
bounds what the next ones would, and by how much every second degree brought less, since a wave may need even or odd ones alone,
tells how far they stay below it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.elements import BoolArray, FloatArray, IntArray
from solvers.accuracy.mesh import shares_of
from solvers.accuracy.plate import ModeErrors, by_degrees, last_degree, mode_errors
from solvers.superelement.cell import Cell, ResidualModes
from solvers.superelement.lattice import ReducedLattice, Waves
from solvers.superelement.periodic import Periodic

# of the largest estimate of a band and those below it, of all: one wave may hide what others show
HIDDEN, BEYOND = 0.3, 0.02
# times the geometric series, of which further degrees brought 0.06 to 2.8 to 12 cells of degrees 5 and 6; and of the last
# degree's part at least, of which they brought 0.48 where the series is shorter; the fewest degrees that tell it
SERIES, MIN_SHARE, MIN_DEGREE = 3.0, 0.5, 5
LOWEST, TRIALS = 0.3, 40  # cut-offs tried, from this share of the lattice's own on
SLIGHT = 1e3  # times the eigenvalue that is rounding: what at least holds rigid motion where degrees are compared
# of what the degree before the last brought: the next one of its parity brought a quarter to a third of it, and a wave that is
# even or odd along the sides hides one of both
OTHER_PARITY = 0.5
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


def reduction_error(lattice: ReducedLattice, wavevectors: FloatArray, count: int) -> ReductionError:
    """Estimate for the `count` lowest bands at wavevectors (n, 2) in rad/m: the worst of them."""
    return error_of_waves(lattice, [lattice.waves(k, count) for k in wavevectors])


def error_of_waves(lattice: ReducedLattice, waves: Sequence[Waves]) -> ReductionError:
    """The same of waves that are solved already."""
    estimates = [truncation(lattice, each) for each in waves]
    modes = max(float(each.max(initial=0.0)) for each, _ in estimates)
    parts = [each for _, each in estimates]
    return ReductionError(modes, further_degrees(parts) * max(float(each[-1].max(initial=0.0)) for each in parts))


def truncation(lattice: ReducedLattice, waves: Waves) -> tuple[FloatArray, FloatArray]:
    """What the modes left out may put each wave off by, (n,), and what each degree along the sides brought it, (degrees, n)
    from 0 on, relative; 0 for rigid-body waves.
    """
    modes = np.where(_moving(waves), waves.by_modes, 0.0)
    return modes, _brought(lattice, waves, lattice.cell.interface.along_side)


def in_order(waves: Waves, rises: FloatArray) -> FloatArray:
    """Rises (n,) of waves, relative, as sorted bands show them: waves that rise by more than others change places."""
    moving = _moving(waves)
    value = np.where(moving, waves.eigenvalue, 1.0)
    risen = np.sort(np.where(moving, value * (1.0 + 2.0 * rises), 0.0))
    return np.where(moving, np.maximum(risen / value - 1.0, 0.0) / 2.0, 0.0)


def further_degrees(parts: Sequence[FloatArray]) -> float:
    """What degrees along the sides beyond the last may bring, of what the last one brought: at most 1.

    parts: of each wavevector what the degrees brought its waves, (degrees, n).

    Parts R_n of a degree n fall as q^(n/2) with the largest q = R_n / R_(n-2) seen: the next two bring (R_n + R_(n-1)) q.
    A degree below 5 shows no q of even and of odd ones.
    """
    worst = np.max([part.max(axis=1, initial=0.0) for part in parts], axis=0)
    if len(worst) <= MIN_DEGREE or worst[-1] <= 0.0:
        return 1.0
    falls = [own / before for own, before in zip(worst[-2:], worst[-4:-2], strict=True) if before > 0.0]
    return float(min(1.0, max(SERIES * (1.0 + worst[-2] / worst[-1]) * max(falls, default=1.0), MIN_SHARE)))


def cutoff_hz(lattice: ReducedLattice, wavevectors: FloatArray, count: int, allowed: float) -> float:
    """The lowest cut-off of fixed-interface modes, Hz, that leaves the `count` lowest bands a half-width of at most `allowed`.

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
    enough = np.flatnonzero(worst <= allowed)
    return float(trials[enough[0]]) if len(enough) else own


def truncation_bars(rises: FloatArray, share: float = 1.0) -> FloatArray:
    """Half-widths of bars by truncation from the estimates of waves (wavevectors, bands), of the same shape; share: of them.

    What waves of the same band or of one below it show, another one may hide; none is off by more than the worst of all.
    """
    worst = rises.max(initial=0.0)
    below = np.maximum.accumulate(rises.max(axis=0, initial=0.0))
    return np.minimum(share * (rises + HIDDEN * below) + BEYOND * worst, share * worst)


def last_degree_through(lattice: ReducedLattice, wavevectors: FloatArray, count: int) -> float:
    """Largest relative rise of the `count` lowest bands without the highest functions through the thickness."""
    across = lattice.cell.interface.across
    if across.max() < 2:  # a plate of linear functions has no lower degree to compare with
        return 0.0
    rises = [_brought(lattice, lattice.waves(k, count), across)[-1] for k in wavevectors]
    return max(float(each.max(initial=0.0)) for each in rises)


def _brought(lattice: ReducedLattice, waves: Waves, degree: IntArray) -> FloatArray:
    """By how much boundary functions of each degree (boundary,) lower each frequency at most, relative, (degrees, n)."""
    free, moving = lattice.cell.interface.free, _moving(waves)
    parts = np.zeros((int(degree.max()) + 1, len(moving)))
    if not moving.any():
        return parts
    order = np.argsort(degree[free], kind="stable")
    still = max(float(waves.eigenvalue[moving].min()), SLIGHT * lattice.rounding)
    lower = np.linalg.cholesky(lattice.boundary(waves.wavevector, still)[np.ix_(order, order)])
    np.add.at(parts, degree[free][order], np.abs(lower.conj().T @ waves.dofs[free][order]) ** 2)
    return np.where(moving, parts / (2.0 * np.where(moving, waves.eigenvalue, 1.0)), 0.0)


def waves_of(row: Periodic, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
    """The `count` lowest frequencies of a row at a wavevector (2,) in rad/m, Hz, and what truncation and the cells' meshes may
    put each of them off by.
    """
    plate = row.at(wavevector)
    tones, waves = plate.waves(count)
    moving, errors_of = tones > STILL * tones[-1], np.zeros((5, len(tones)))
    pencil, dofs = plate.pencil(), waves[:, moving]
    errors = mode_errors(plate, pencil, dofs, rims=1.0)
    before = OTHER_PARITY * by_degrees(pencil, dofs, last_degree(plate, before=1))
    degrees = np.maximum(errors.degrees, before)
    errors_of[:, moving] = errors.modes, degrees, errors.through, errors.taken, errors.mesh
    return tones, ModeErrors(*errors_of)


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
    return MeshErrors(error.taken * layer, shares_of(error).of_modes(waves.eigenvalue, layer, order))
