"""A cell reduced for the Bloch waves of its own mesh: over its waves at a few wavevectors.

Boundary polynomials and fixed-interface modes give the first waves at these. A wave u at the eigenvalue l leaves the residual
r = (K - l M) u inside; the vectors K_II^-1 r and K_II^-1 M K_II^-1 r join the modes. Lower bounds at other wavevectors say how
far their waves lie above the mesh's. Where that is too far, all samples come nearer to the mesh's own waves, and the worst of
the others join them: the cell whose sides move freely answers what a wave leaves, its sides included (`Enclosure.nearer`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from scipy.linalg import block_diag, eigh, qr, svd

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.accuracy.reduction import STILL
from solvers.fem.assembly import Scale, System, on_components
from solvers.fem.eigen import uncounted
from solvers.superelement.cell import Expansion
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import ReducedLattice, Waves, times
from solvers.superelement.reduction import CellBuilder, SymmetryClass
from solvers.threads import one_thread
from solvers.waves.bloch import BlochCell
from solvers.waves.enclosure import Enclosure

ADDS_NOTHING = 1e-10  # relative change of an eigenvalue by a combination of interior vectors
SAME = 1e-9  # of the largest singular value: combinations of waves that are others' already
MODES = 3  # times the number of bands: fixed-interface modes
SPARE = 4  # waves sampled above those requested: one of them at least lies apart from the bands
SHIFT = 0.1  # of the highest band's eigenvalue: what holds the cell whose sides move freely
BETWEEN = 1.5  # error at any wavevector over the largest of those checked
AT_ONCE, ROUNDS = 6, 6  # wavevectors that join the samples together, and how often errors are bounded at most


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
        reduced = _Enriched(system, interface, count, edges_m)
        lattice, waves = Lattice(*reduced.cell.vectors_m.tolist()), reduced.waves(sampled, count + SPARE)
        del reduced  # its shapes and its factor take as much as what follows
        sampling = _Sampling(system, count, lattice)
        sampling.sample(sampled, iter(waves))
        del waves
        return sampling.reduced(checked, allowed)


class _Sampling:
    """A mesh with its ties, its waves at the wavevectors sampled, what these span (dof, n), and the lattice over it."""

    def __init__(self, system: System, count: int, lattice: Lattice) -> None:
        self.system, self.count, self.mesh = system, count, BlochCell(system, lattice)
        self.sampled, self.basis = np.empty((0, 2)), np.empty((self.mesh.dof, 0))

    def sample(self, wavevectors: FloatArray, motions: Iterator[ComplexArray]) -> None:
        """Make the lattice over waves (3n, count + SPARE) at some wavevectors, in the place of those sampled before."""
        width = self.count + SPARE
        parts = np.empty((self.mesh.dof, 2 * width * len(wavevectors)), order="F")
        for first, motion in zip(range(0, parts.shape[1], 2 * width), motions, strict=True):
            own = self.mesh.led(motion)
            parts[:, first : first + width], parts[:, first + width : first + 2 * width] = own.real, own.imag
        del self.basis  # whose memory the next one takes
        spanned, mix = qr(parts, overwrite_a=True, mode="economic", check_finite=False)
        turn, size, _ = svd(mix)
        self.sampled, self.basis = wavevectors, spanned @ turn[:, size > SAME * size[0]]
        self.lattice = SampledLattice(*self.mesh.over(self.basis), self.mesh.lattice.vectors_m, self.mesh.scale)

    def reduced(self, checked: FloatArray, allowed: float) -> tuple[SampledLattice, float]:
        """The lattice over the waves sampled, and the largest error at other wavevectors, some of which join the first."""
        top = max(self.lattice.solve(k, self.count)[0][-1] for k in checked)
        bounds = Enclosure(self.system, self.mesh, SHIFT * float(top))
        for rounds in range(ROUNDS):
            errors = BETWEEN * np.array([self._error(bounds, k) for k in checked])
            worst = checked[np.argsort(-errors)[: min(AT_ONCE, np.count_nonzero(errors > allowed))]]
            if rounds == ROUNDS - 1 or not len(worst):
                break
            joined = np.unique(np.vstack([self.sampled, worst]), axis=0)
            self.sample(joined, (bounds.nearer(k, *self._waves(k)) for k in joined))
        return self.lattice, float(errors.max())

    def _error(self, bounds: Enclosure, k: FloatArray) -> float:
        """Largest relative error of a moving wave's frequency at a wavevector, to first order."""
        motion, values = self._waves(k)
        rises = bounds.rises(k, motion, values, self.count)
        values = values[: self.count]
        moving = values > STILL**2 * values[-1]
        return float((rises[moving] / (2.0 * values[moving])).max(initial=0.0))

    def _waves(self, k: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """Motions (3n, count + SPARE) and eigenvalues of the waves at a wavevector."""
        values, vectors = self.lattice.solve(k, self.count + SPARE)
        return self.mesh.motion(k, times(self.basis, vectors)), values


class _Enriched:
    """A reduced cell, its shapes on the mesh, and its interior with its factor.

    shapes: of the boundary functions, of the fixed-interface modes, and for each wavevector those of the interior that its
    waves added; all but the first are K-orthonormal.
    """

    def __init__(self, system: System, interface: Interface, count: int, edges_m: FloatArray | None) -> None:
        self.system = system
        builder = CellBuilder(system, interface, (), (), edges_m)
        clamped = builder.clamp({})
        self.sector, self.factor, self.shapes = clamped.sector, clamped.factor, [clamped.shapes]
        none = np.zeros((clamped.basis.shape[1],) * 2)
        values, vectors = uncounted(self.sector.pencil, self.factor, MODES * count)
        top_hz = float(system.scale.frequency(values)[-1])
        whole = builder.join([SymmetryClass({}, clamped.basis, clamped.shapes, np.empty(0), top_hz, none)])
        builder.check(whole)
        undrawn = Expansion.nothing(whole.dof)
        self.cell = replace(whole, touch=undrawn, skin=undrawn, bare=None)
        self._attach(self.sector.spread(vectors / np.sqrt(values)))

    def waves(self, wavevectors: FloatArray, count: int) -> list[ComplexArray]:
        """The motion of every node (3n, count) in the lowest waves at some wavevectors, whose answers join the interior."""
        lattice = ReducedLattice(self.cell)
        for waves in [lattice.waves(k, count) for k in wavevectors]:
            self._enrich(waves)
        lattice = ReducedLattice(self.cell)
        return [self._motion(lattice.waves(k, count).dofs) for k in wavevectors]

    def _motion(self, dofs: ComplexArray) -> ComplexArray:
        """Motion of every node (3n, k) by the cell's degrees of freedom, or by those that it had before others joined them."""
        ends = np.cumsum([own.shape[1] for own in self.shapes])
        return np.asarray(sum(map(times, self.shapes, np.split(dofs, ends[ends < len(dofs)]))))

    def _enrich(self, waves: Waves) -> None:
        """Join further vectors of the interior to the cell: those with which the waves answer what they leave."""
        moving = waves.eigenvalue > STILL**2 * waves.eigenvalue[-1]
        wave = self._motion(waves.dofs[:, moving])
        motion, value = np.hstack([wave.real, wave.imag]), np.tile(waves.eigenvalue[moving], 2)
        left = self.system.stiffness @ motion - on_components(self.system.mass, motion) * value
        first = self.factor.solve(self.sector.restrict(left)) / np.sqrt(value)
        second = self.factor.solve(self.sector.pencil.apply_mass(first)) * value
        self._attach(self.sector.spread(np.hstack([first, second])))

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
