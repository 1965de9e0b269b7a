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
import scipy.sparse as sp
from scipy.linalg import block_diag, eigh, svd

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.accuracy.reduction import STILL
from solvers.fem.assembly import Scale, System, on_components
from solvers.fem.eigen import uncounted
from solvers.fem.factor import Factor, Factoriser
from solvers.superelement.cell import Expansion
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import ReducedLattice, Waves, times
from solvers.superelement.reduction import CellBuilder, ClassSector, Sector, SymmetryClass
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
    """A reduced cell, its shapes on the mesh, its interior with its factor, and the waves sampled so far.

    shapes: those of the boundary functions, of the fixed-interface modes, and for each sample those of the interior that it
    added; all but the first are K-orthonormal. interior: None where its memory was given back. free: the samples' free degrees
    of freedom.
    """

    interior: tuple[Sector, Factor] | None

    def __init__(self, system: System, interface: Interface, count: int, edges_m: FloatArray | None) -> None:
        self.system, self.count = system, count
        builder = CellBuilder(system, interface, (), (), edges_m)
        clamped = builder.clamp({})
        sector, self.shapes = clamped.sector, [clamped.shapes]
        self.inside, self.interior = builder.inside, (sector, clamped.factor)
        none = np.zeros((clamped.basis.shape[1],) * 2)
        values, vectors = uncounted(sector.pencil, clamped.factor, MODES * count)
        top_hz = float(system.scale.frequency(values)[-1])
        whole = builder.join([SymmetryClass({}, clamped.basis, clamped.shapes, np.empty(0), top_hz, none)])
        builder.check(whole)
        undrawn = Expansion.nothing(whole.dof)
        self.cell = replace(whole, touch=undrawn, skin=undrawn, bare=None)
        self._attach(sector.spread(vectors / np.sqrt(values)))
        self.lattice = ReducedLattice(self.cell)
        self.free = np.empty((self.lattice.dof, 0))

    def reduced(self, sampled: FloatArray, checked: FloatArray, allowed: float) -> tuple[SampledLattice, float]:
        """The lattice over the waves at some wavevectors, and the largest error at others, some of which join the first."""
        bounds, known, errors = None, np.zeros(len(checked), dtype=bool), np.full(len(checked), inf)
        for _ in range(ROUNDS):
            condensed, basis = self._condensed(sampled)
            self.interior = None  # the bounds' factor takes as much
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
        """Motion of every node (3n, k) by the cell's degrees of freedom, or by those that it had before others joined them."""
        ends = np.cumsum([own.shape[1] for own in self.shapes])
        return np.asarray(sum(map(times, self.shapes, np.split(dofs, ends[ends < len(dofs)]))))

    def _condensed(self, wavevectors: FloatArray) -> tuple[SampledLattice, FloatArray]:
        """The lattice over the real and imaginary parts of the waves sampled so far and at some wavevectors, and its basis."""
        for waves in [self.lattice.waves(k, self.count + SPARE) for k in wavevectors]:
            self._enrich(waves)
        self.lattice = lattice = ReducedLattice(self.cell)
        dofs = np.hstack([lattice.waves(k, self.count + SPARE).dofs for k in wavevectors])
        first = (lattice.offset == 0.0).all(axis=1)
        own = np.empty((lattice.dof, dofs.shape[1]), dtype=complex)
        own[lattice.column[first]] = dofs[first]
        known = np.vstack([self.free, np.zeros((lattice.dof - len(self.free), self.free.shape[1]))])
        self.free = np.hstack([known, own.real, own.imag])
        basis, size, _ = svd(self.free, full_matrices=False)
        basis = basis[:, size > SAME * size[0]]
        steps, *whole = lattice.steps
        stiffness, mass = (basis.T @ each.reshape(-1, lattice.dof, lattice.dof) @ basis for each in whole)
        del lattice.steps, whole  # made again only if more wavevectors join
        return SampledLattice(steps, stiffness, mass, lattice.cell.vectors_m, lattice.cell.scale), basis

    def _left(self, waves: Waves) -> tuple[FloatArray, FloatArray]:
        """Nodal loads (3n, 2k) that real and imaginary parts of moving waves leave, and their eigenvalues (2k,)."""
        moving = waves.eigenvalue > STILL**2 * waves.eigenvalue[-1]
        wave = self._motion(waves.dofs[:, moving])
        motion = np.hstack([wave.real, wave.imag])
        value = np.tile(waves.eigenvalue[moving], 2)
        return self.system.stiffness @ motion - on_components(self.system.mass, motion) * value, value

    def _enrich(self, waves: Waves) -> None:
        """Join further vectors of the interior to the cell: those with which a sample answers what it leaves."""
        if self.interior is None:
            again = ClassSector(self.system, self.inside)
            self.interior = again, Factoriser()(sp.csc_array(again.pencil.stiffness))
        sector, factor = self.interior
        left, value = self._left(waves)
        first = factor.solve(sector.restrict(left)) / np.sqrt(value)
        second = factor.solve(sector.pencil.apply_mass(first)) * value
        self._attach(sector.spread(np.hstack([first, second])))

    def _attach(self, field: FloatArray) -> None:
        """Join what shapes (3n, k) of the interior add to those that the cell has, K-orthonormal."""
        for _ in range(2):  # the second time takes out the rounding of remainders that were small
            pulled = self.system.stiffness @ field
            for own in self.shapes[1:]:
                field = field - own @ (own.T @ pulled)
            strength, turn = eigh(field.T @ (self.system.stiffness @ field))
            kept = strength > ADDS_NOTHING
            if not kept.any():
                return
            field = field @ (turn[:, kept] / np.sqrt(strength[kept]))
        cell, heavy = self.cell, on_components(self.system.mass, field)
        coupling = np.vstack([own.T @ heavy for own in self.shapes])
        self.shapes.append(field)
        self.cell = replace(
            cell, stiffness=block_diag(cell.stiffness, np.eye(field.shape[1])),
            mass=np.block([[cell.mass, coupling], [coupling.T, field.T @ heavy]]),
            fixed_hz=np.append(cell.fixed_hz, np.full(field.shape[1], inf)),
            fixed_parity=np.vstack([cell.fixed_parity, np.zeros((field.shape[1], 2), dtype=np.int64)]),
        )  # fmt: skip
