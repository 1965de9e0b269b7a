"""A cell reduced for the Bloch waves of its own mesh: boundary polynomials and fixed-interface modes, enriched and condensed by
waves at a few wavevectors.

A wave u of the reduced cell at eigenvalue l leaves the residual r = (K - l M) u inside. The vectors K_II^-1 r and K_II^-1 M
K_II^-1 r of the sampled waves join the fixed-interface modes. The degrees of freedom that the samples combine are the basis
at every wavevector. Lower bounds at others say how far its waves lie above the mesh's; where that is too far, they are
sampled, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np
from scipy.linalg import block_diag, eigh, svd

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.accuracy.reduction import STILL
from solvers.fem.assembly import Scale, System, on_components
from solvers.fem.eigen import Shared, modes_near
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import ReducedLattice, Waves, times
from solvers.superelement.reduction import CellBuilder, SymmetryClass
from solvers.threads import one_thread
from solvers.waves.enclosure import Enclosure

ADDS_NOTHING = 1e-10  # relative change of an eigenvalue by a combination of interior vectors
SAME = 1e-9  # of the largest singular value: combinations of waves that are others' already
MODES = 3  # times the number of bands: fixed-interface modes
SPARE = 4  # waves sampled above those requested: one of them at least lies apart from the bands
SHIFT = 0.1  # of the highest band's eigenvalue: what holds the cell whose sides move freely
BETWEEN = 1.5  # error at any wavevector over the largest of those checked
AT_ONCE, ROUNDS = 6, 4  # wavevectors that join the samples together, and how often


@dataclass(frozen=True)
class SampledLattice:
    """K_d and M_d (9, n, n) over the sampled waves, by the steps d (9, 2) in cells; vectors (2, 2), m, of the lattice."""

    steps: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    vectors_m: FloatArray
    scale: Scale

    @property
    def dof(self) -> int:
        """Degrees of freedom per wavevector."""
        return int(self.stiffness.shape[-1])

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ComplexArray]:
        """Solve the lowest eigenvalues (count,) at a wavevector (2,) in rad/m, and their vectors (dof, count)."""
        turn = np.exp(1j * self.steps @ (self.vectors_m @ np.asarray(wavevector, dtype=float)))
        stiffness, mass = (np.tensordot(turn, each, 1) for each in (self.stiffness, self.mass))
        values, vectors = eigh(stiffness, mass, subset_by_index=[0, min(count, self.dof) - 1], driver="gvx")
        return values, vectors

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """Solve the `count` lowest frequencies at a wavevector (2,) in rad/m, ascending, Hz."""
        return self.scale.frequency(np.maximum(self.solve(wavevector, count)[0], 0.0))


def sampled_lattice(
    system: System, interface: Interface, sampled: FloatArray, checked: FloatArray, count: int, allowed: float,
    edges_m: FloatArray | None = None,
) -> tuple[SampledLattice, float]:  # fmt: skip
    """Reduce a meshed cell whose sides are faces of bare plate for its lowest Bloch waves.

    Parameters
    ----------
    system : System
        Assembled matrices of a mesh with its middle at the origin.
    interface : Interface
        Degrees of the boundary functions.
    sampled, checked : ndarray, shape (n, 2)
        Wavevectors in rad/m whose waves are the basis, and those at which they are compared with lower bounds.
    count : int
        Number of bands.
    allowed : float
        Relative error of a frequency up to which no further wavevectors are sampled.
    edges_m : ndarray, shape (2, 2), optional
        Vectors along the sides of an oblique cell.

    Returns
    -------
    lattice : SampledLattice
        The reduced cell.
    error : float
        Largest relative excess of a frequency over that of the mesh, with a margin for wavevectors that were not checked.

    Raises
    ------
    SolverError
        If a rigid-body mode meets a force or the mass is wrong.
    """
    with one_thread():
        return _Sampling(system, interface, count, edges_m).reduced(sampled, checked, allowed)


class _Sampling:
    """A reduced cell, its shapes on the mesh, the factor of its clamped interior, and the waves sampled so far.

    shapes: those of the boundary functions and fixed-interface modes, and for each sample those of the interior that it added;
    inner: all of the latter, K-orthonormal; free: the samples' free degrees of freedom.
    """

    def __init__(self, system: System, interface: Interface, count: int, edges_m: FloatArray | None) -> None:
        self.system, self.count = system, count
        builder = CellBuilder(system, interface, (), (), edges_m)
        clamped = builder.clamp({})
        self.sector, self.factor = clamped.sector, clamped.factor
        lowest = modes_near(self.sector.pencil, 0.0, MODES * count, Shared(clamped.factorise, self.factor))
        self.shapes = [np.hstack([clamped.shapes, self.sector.spread(lowest.vectors)])]
        basis, tones = clamped.basis, lowest.frequency_hz
        del clamped  # its shapes are held twice
        none = np.zeros((basis.shape[1],) * 2)
        part = SymmetryClass({}, basis, self.shapes[0], tones, float(tones[-1]), none)
        self.cell = builder.join([part])
        builder.check(self.cell)
        self.lattice = ReducedLattice(self.cell)
        self.inner = np.empty((self.sector.pencil.dof, 0))
        self.free = np.empty((self.lattice.dof, 0))

    def reduced(self, sampled: FloatArray, checked: FloatArray, allowed: float) -> tuple[SampledLattice, float]:
        """The lattice over the waves at some wavevectors, and the largest error at others, some of which join the first."""
        bounds, known, errors = None, np.zeros(len(checked), dtype=bool), np.full(len(checked), inf)
        for _ in range(ROUNDS):
            condensed, basis = self._condensed(sampled)
            if bounds is None:
                top = max(condensed.solve(k, self.count)[0][-1] for k in checked)
                bounds = Enclosure(self.system, Lattice(*self.cell.vectors_m.tolist()), SHIFT * float(top))
            high = np.flatnonzero(BETWEEN * errors > allowed)
            errors[high] = [self._error(bounds, condensed, basis, k) for k in checked[high]]
            high = high[BETWEEN * errors[high] > allowed]
            if not len(high) or known[high].any():  # a sampled wave that lies too high lacks boundary functions
                break
            worst = high[np.argsort(-errors[high])[:AT_ONCE]]
            known[worst], sampled = True, checked[worst]
        return condensed, BETWEEN * float(errors.max())

    def _error(self, bounds: Enclosure, condensed: SampledLattice, basis: FloatArray, k: FloatArray) -> float:
        """Largest relative error of a moving wave's frequency at a wavevector, to first order."""
        values, vectors = condensed.solve(k, self.count + SPARE)
        turn = np.exp(1j * self.lattice.offset @ (condensed.vectors_m @ k))[:, None]
        motion = self._motion(turn * times(basis, vectors)[self.lattice.column])
        rises = bounds.rises(k, motion, values, self.count)
        values = values[: self.count]
        moving = values > STILL**2 * values[-1]
        return float((rises[moving] / (2.0 * values[moving])).max(initial=0.0))

    def _motion(self, dofs: ComplexArray) -> ComplexArray:
        """Motion of every node (3n, k) by the cell's degrees of freedom."""
        ends = np.cumsum([own.shape[1] for own in self.shapes])
        return np.asarray(sum(map(times, self.shapes, np.split(dofs, ends[:-1]))))

    def _condensed(self, wavevectors: FloatArray) -> tuple[SampledLattice, FloatArray]:
        """The lattice over the real and imaginary parts of the waves sampled so far and at some wavevectors, and its basis."""
        self._enrich([self.lattice.waves(k, self.count + SPARE) for k in wavevectors])
        self.lattice = lattice = ReducedLattice(self.cell)
        waves = np.hstack([lattice.waves(k, self.count + SPARE).dofs for k in wavevectors])
        first = (lattice.offset == 0.0).all(axis=1)
        own = np.empty((lattice.dof, waves.shape[1]), dtype=complex)
        own[lattice.column[first]] = waves[first]
        known = np.vstack([self.free, np.zeros((lattice.dof - len(self.free), self.free.shape[1]))])
        self.free = np.hstack([known, own.real, own.imag])
        basis, size, _ = svd(self.free, full_matrices=False)
        basis = basis[:, size > SAME * size[0]]
        steps, *whole = lattice.steps
        stiffness, mass = (basis.T @ each.reshape(-1, lattice.dof, lattice.dof) @ basis for each in whole)
        return SampledLattice(steps, stiffness, mass, lattice.cell.vectors_m, lattice.cell.scale), basis

    def _left(self, waves: Waves) -> tuple[FloatArray, FloatArray]:
        """Loads (free, 2n) that real and imaginary parts of moving waves leave inside, and their eigenvalues (2n,)."""
        moving = waves.eigenvalue > STILL**2 * waves.eigenvalue[-1]
        wave = self._motion(waves.dofs[:, moving])
        motion = np.hstack([wave.real, wave.imag])
        value = np.tile(waves.eigenvalue[moving], 2)
        left = self.system.stiffness @ motion - on_components(self.system.mass, motion) * value
        return self.sector.restrict(left), value

    def _enrich(self, samples: list[Waves]) -> None:
        """Join further vectors of the interior, K-orthonormal, to the cell's fixed-interface modes."""
        sector, cell = self.sector, self.cell
        left, value = (np.concatenate(parts, axis=-1) for parts in zip(*map(self._left, samples), strict=True))
        first = self.factor.solve(left) / np.sqrt(value)
        second = self.factor.solve(sector.pencil.apply_mass(first)) * value
        both = np.hstack([first, second])
        both -= self.inner @ (self.inner.T @ (sector.pencil.stiffness @ both))
        strength, turn = eigh(both.T @ (sector.pencil.stiffness @ both))
        kept = strength > ADDS_NOTHING
        inner = both @ (turn[:, kept] / np.sqrt(strength[kept]))
        self.inner = np.hstack([self.inner, inner])
        field = sector.spread(inner)
        heavy = on_components(self.system.mass, field)
        coupling = np.vstack([own.T @ heavy for own in self.shapes])
        mass = np.block([[cell.mass, coupling], [coupling.T, field.T @ heavy]])
        self.shapes.append(field)
        self.cell = replace(
            cell, stiffness=block_diag(cell.stiffness, np.eye(inner.shape[1])), mass=mass,
            fixed_hz=np.append(cell.fixed_hz, np.full(inner.shape[1], inf)),
        )  # fmt: skip
