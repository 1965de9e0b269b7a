"""Eigenpairs of K x = lambda M x by shift-invert Lanczos, counted by inertia so that none is missing.

Every solve proves itself: residuals, M-orthonormality, and Sylvester's count at both ends of the interval (parlett1998).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

from geometry.elements import BoolArray, FloatArray, IntArray
from solvers.errors import CountMismatch, SingularShift, SolverError
from solvers.fem.assembly import Scale
from solvers.fem.block_lanczos import Basis, Operator, block_lanczos
from solvers.fem.factor import Factor, Factoriser
from solvers.fem.followed import followed

RESIDUAL = 1e-8  # ||K x - l M x|| / (||K|| ||x||): above it a pair is not returned
FOLLOWED = 1e-7  # of pairs that follow from another pencil's: 1e-7 of a frequency, since it enters squared
ORTHONORMAL = 1e-8
# above it a solve was disturbed: rounding leaves 1e-16, the stop rule of Lanczos 1e-13
CLEAN_RESIDUAL = RESIDUAL / 100.0
PASSES = 3  # over the pairs that are not clean
# shares of the pencil's norm ratio tried as the floor above rigid-body modes
RIGID = tuple(10.0**-n for n in range(9, 16))
MAX_ROUND_OFF = 0.02  # relative error of a frequency by rounding above which it is rejected
SLIGHT = 1e-8  # of a frequency: rounding too small to be examined
EPSILON = float(np.finfo(float).eps)
# eigenpairs of a slice that, with as many beyond it, cost less from the factor at its end than from another factor
FEW = 6
# Relative moves of a shift if a factorisation is rejected: a count belongs to its frequency, a search may stand aside.
COUNTED = (0.0, 3e-7, 1.8e-6, 8.1e-6, 3.2e-5, 1.2e-4)
SEARCHED = (0.0, 1e-5, 1e-3, 1e-2)


@dataclass(frozen=True)
class PlainPencil:
    """Interface of a pencil: symmetric sparse K and M, their units, and the number of rigid-body modes."""

    stiffness: sp.csc_array
    mass: sp.csc_array
    scale: Scale
    rigid_count: int = 0

    @property
    def dof(self) -> int:
        """Unknowns."""
        return int(self.stiffness.shape[0])

    def apply_mass(self, vectors: FloatArray) -> FloatArray:
        """M x."""
        return np.asarray(self.mass @ vectors)

    def without(self, solve: Operator, vectors: FloatArray) -> Operator:
        """The solve with M-orthonormal eigenvectors (dof, k) projected out before and after it."""
        weighted = self.apply_mass(vectors)

        def deflated(right: FloatArray) -> FloatArray:
            solution = solve(right - weighted @ (vectors.T @ right))
            return np.asarray(solution - vectors @ (weighted.T @ solution))

        return deflated


@dataclass(frozen=True)
class Count:
    """Sylvester's count of the elastic eigenvalues between two frequencies against what was found; below: all up to low_hz."""

    low_hz: float
    high_hz: float
    expected: int
    found: int
    below: int | None = None


@dataclass
class Shared:
    """Shared state of the solves of one pencil: the symbolic analysis, the counts so far, a factor of K if there is one.

    near: a factor of K - s M and its s, where one is kept for what follows; keeps: the last slice's is kept.
    guess: motions (dof, k) near the modes of the next window.
    """

    factorise: Factoriser = field(default_factory=Factoriser)
    static: Factor | None = None
    counts: dict[float, int] = field(default_factory=dict)
    near: tuple[Factor, float] | None = None
    keeps: bool = False
    guess: FloatArray | None = None
    _norms: tuple[float, float] | None = None

    def norms_of(self, pencil: PlainPencil) -> tuple[float, float]:
        """Largest column sums |K| and |M|."""
        if self._norms is None:
            stiff, heavy = (float(_column_sums(each).max(initial=0.0)) for each in (pencil.stiffness, pencil.mass))
            self._norms = stiff, heavy
        return self._norms


def _column_sums(matrix: sp.csc_array) -> FloatArray:
    """Sums of moduli column by column, (dof,), without a copy of the pattern."""
    sums, filled = np.zeros(matrix.shape[1]), np.diff(matrix.indptr) > 0
    if filled.any():
        sums[filled] = np.add.reduceat(np.abs(matrix.data), matrix.indptr[:-1][filled])
    return sums


@dataclass(frozen=True)
class Modes:
    """Elastic modes in ascending order.

    frequency_hz (k,), vectors (dof, k) M-orthonormal in the scaled units of the pencil, residual (k,), rounding (k,):
    estimated relative error of each frequency by the rounding of K, eps |x|'|K||x| / (2 lambda), or a bound of it.
    """

    frequency_hz: FloatArray
    vectors: FloatArray
    residual: FloatArray
    rounding: FloatArray
    count: Count
    rigid_count: int
    factorisations: int


def modes_in_band(pencil: PlainPencil, low_hz: float, high_hz: float, backend: str | Shared | None = None) -> Modes:
    """Compute every elastic mode in a frequency band.

    Parameters
    ----------
    pencil : PlainPencil
        Stiffness and mass, both (dof, dof), with their units.
    low_hz, high_hz : float
        Ends of the band in Hz, inclusive.
    backend : str or Shared, optional
        Name of a factorisation, or the counts and factors that earlier solves of this pencil share; its factor of K serves a
        band from 0.

    Returns
    -------
    Modes
        Ascending frequencies (k,) in Hz, M-orthonormal vectors (dof, k), residuals (k,) and the inertia count.

    Raises
    ------
    CountMismatch
        If the number of modes found differs from Sylvester's inertia count of the band.
    SolverError
        If a residual, the orthonormality or the round-off exceeds its limit.

    References
    ----------
    .. [1] parlett1998 (docs/references.bib)
    """
    solver = _Solver(pencil, backend)
    scale = pencil.scale
    low, high = scale.eigenvalue(low_hz), scale.eigenvalue(high_hz)
    low = low if low > RIGID[0] * solver.norm_ratio else max(low, solver.rigid_limit)
    below_low = solver.count_below(low) if low > 0.0 else 0
    values, vectors = solver.between(low, high, below_low, solver.count_below(high))
    return solver.verified(values, vectors, low, high, below_low)


def modes_near(pencil: PlainPencil, near_hz: float, count: int, backend: str | Shared | None = None) -> Modes:
    """Compute the elastic modes nearest to a frequency, with whole clusters at the ends of their interval.

    Parameters
    ----------
    pencil : PlainPencil
        Stiffness and mass, both (dof, dof), with their units.
    near_hz : float
        The frequency in Hz.
    count : int
        Number of modes; a cluster at an end may add some.
    backend : str or Shared, optional
        As in `modes_in_band`.

    Returns
    -------
    Modes
        As in `modes_in_band`.

    Raises
    ------
    CountMismatch
        If no gap ends a cluster, or the inertia count disagrees.
    SolverError
        If a check of the modes fails.
    """
    solver = _Solver(pencil, backend)
    target = pencil.scale.eigenvalue(near_hz)
    count = min(count, pencil.dof - pencil.rigid_count)
    requested = count + 1
    while True:
        values, vectors = solver.nearest(target, min(requested + pencil.rigid_count, pencil.dof))
        floor = solver.floor_among(values) if values.min(initial=np.inf) <= RIGID[0] * solver.norm_ratio else 0.0
        elastic = values > floor
        if not pencil.rigid_count and not elastic.all():
            raise SolverError("an eigenvalue below zero: the body is so slender that rounding hides its lowest modes")
        kept, low, high = _closed_interval(values[elastic], target, count, pencil, floor)
        if kept is not None or requested >= pencil.dof:
            break
        requested += max(4, count // 4)
    if kept is None:
        raise CountMismatch(f"no gap ends the cluster of modes near {near_hz:.1f} Hz; request a band instead")
    below = solver.count_below(low) if low > 0.0 else 0
    values, vectors = values[elastic][kept], vectors[:, elastic][:, kept]
    if solver.count_below(high) - below != len(values):
        values, vectors = solver.between(low, high, below, solver.count_below(high))
        kept, *ends = _closed_interval(values, target, count, pencil, floor)
        if kept is not None:  # the interval was too wide for want of the modes that it holds
            values, vectors, (low, high) = values[kept], vectors[:, kept], ends
            below = solver.count_below(low) if low > 0.0 else 0
    if len(values) < count:
        raise CountMismatch(f"only {len(values)} of {count} modes near {near_hz:.6g} Hz agree with the inertia count")
    return solver.verified(values, vectors, low, high, below)


def factor_near(
    pencil: PlainPencil, shift: float, factorise: Callable[[sp.csc_array], Factor], least: float = 0.0
) -> tuple[Factor, float]:
    """Factorise K - s M at a shift, or at the nearest of a few next to it at which the factorisation is reliable.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    shift : float
        Scaled eigenvalue.
    factorise : callable
        Factorises a sparse array (dof, dof).
    least : float, optional
        First step away from a shift of 0, as a scaled eigenvalue.

    Returns
    -------
    factor : Factor
        With its count of negative pivots.
    shift : float
        s, scaled.

    Raises
    ------
    SingularShift
        If none of them is reliable.
    """
    return next(_factors_near(pencil, shift, factorise, least, COUNTED))


def _factors_near(
    pencil: PlainPencil,
    shift: float,
    factorise: Callable[[sp.csc_array], Factor],
    least: float,
    moves: tuple[float, ...],
) -> Iterator[tuple[Factor, float]]:
    """Factors of K - s M, and s, for each move of the shift with a reliable factorisation. Raises SingularShift without one."""
    refused, made = None, False
    for attempt, move in enumerate(moves):
        moved = shift * (1.0 + move) if shift else attempt * least
        try:
            factor = factorise(sp.csc_array(pencil.stiffness - moved * pencil.mass))
        except SingularShift as fault:
            refused = refused or fault
        else:
            made = True
            yield factor, moved
    if refused and not made:
        raise refused


def lowest_pairs(
    pencil: PlainPencil, count: int, multiplicity: int = 1, factorise: Factoriser | None = None
) -> tuple[FloatArray, FloatArray]:
    """Compute the lowest eigenpairs including rigid ones; an inertia count above them proves that none is missing.

    The shift lies below zero, where K - sigma M is positive definite.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    count : int
        Number of distinct eigenvalues.
    multiplicity : int, optional
        Multiplicity of each.
    factorise : Factoriser, optional
        With the symbolic analysis of pencils of the same sparsity pattern.

    Returns
    -------
    values : ndarray, shape (count multiplicity,)
        Scaled eigenvalues, ascending.
    vectors : ndarray, shape (dof, count multiplicity)
        M-orthonormal.

    Raises
    ------
    CountMismatch
        If the inertia count is another one.
    SolverError
        For a negative eigenvalue or a large residual.
    """
    solver = _Solver(pencil, Shared(factorise) if factorise else None)
    size = count * multiplicity
    shift = -1e-6 * solver.norm_ratio
    factor, shift = solver.factor(shift)
    if factor.negative:
        raise SolverError(f"{factor.negative} eigenvalue(s) below zero: the stiffness is not positive")
    values, vectors = solver.lanczos(factor.solve, shift, min(size + 4 * multiplicity, pencil.dof - 2))
    gap = _first_gap(values, size)
    residual = solver.residual(values[:gap], vectors[:, :gap]).max()
    if residual > RESIDUAL:
        raise SolverError(f"residual {residual:.1e} (limit {RESIDUAL:.0e}): refine the mesh or request fewer bands")
    edge = 0.5 * (values[gap - 1] + values[gap])
    expected = solver.count_below(edge)
    if expected != gap:
        raise CountMismatch(f"{gap} eigenvalues found below {edge:.6g}, but the inertia count is {expected}")
    return np.asarray(values[:size]), np.asarray(vectors[:, :size])


def lowest_hz(pencil: PlainPencil, static: Factor) -> float:
    """Compute the lowest frequency of a body without rigid-body motion, less the error bound of Lanczos.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    static : Factor
        Factor of K.

    Returns
    -------
    float
        In Hz.
    """
    values = uncounted(pencil, static, 1)[0] if pencil.dof > 2 else np.array([np.inf])
    return float(pencil.scale.frequency(values)[0]) * (1.0 - 1e-6)


def uncounted(pencil: PlainPencil, static: Factor, count: int) -> tuple[FloatArray, FloatArray]:
    """Compute the lowest modes of a body without rigid-body motion by Lanczos, which may miss one of a cluster.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    static : Factor
        Factor of K.
    count : int
        Number of modes, fewer than the degrees of freedom.

    Returns
    -------
    tuple of ndarray, shapes (count,) and (dof, count)
        Scaled eigenvalues and M-orthonormal vectors.
    """
    return _Solver(pencil, None).lanczos(static.solve, 0.0, count)


def count_below(pencil: PlainPencil, frequency_hz: float, factorise: Factoriser | None = None) -> int:
    """Count the eigenvalues below a frequency by Sylvester's law of inertia, rigid-body modes included.

    Parameters
    ----------
    pencil : PlainPencil
        Scaled K and M, (dof, dof).
    frequency_hz : float
        The frequency.
    factorise : Factoriser, optional
        Its symbolic analysis is reused.

    Returns
    -------
    int
        Number of eigenvalues.
    """
    shared = Shared(factorise) if factorise else None
    return _Solver(pencil, shared).count_below(pencil.scale.eigenvalue(frequency_hz))


def _first_gap(values: FloatArray, size: int) -> int:
    """Number of the values, at least `size`, that end in a gap."""
    for end in range(size, len(values)):
        if values[end] - values[end - 1] > 1e-6 * values[end]:
            return end
    raise CountMismatch("no gap ends the cluster above the requested bands; request more bands")


def _closed_interval(
    values: FloatArray, target: float, count: int, pencil: PlainPencil, floor: float
) -> tuple[FloatArray | None, float, float]:
    """The nearest `count` values and an interval, ending in gaps, which holds them and nothing else that is known.

    Distances are measured in frequency, as the user means them.
    """
    root, aim = np.sqrt(np.maximum(values, 0.0)), np.sqrt(target)
    order = np.argsort(np.abs(root - aim), kind="stable")
    everything = len(values) + pencil.rigid_count >= pencil.dof
    if len(values) <= count and not everything:
        return None, 0.0, 0.0
    for size in range(min(count, len(values)), len(values) + 1):
        if size == len(values) and not everything:
            return None, 0.0, 0.0
        inner = np.abs(root - aim)[order[:size]].max()
        outer = np.abs(root - aim)[order[size]] if size < len(values) else inner * 1.1 + 0.1 * aim
        if outer - inner > 1e-6 * max(aim, outer):
            edge = 0.5 * (inner + outer)
            low = max(aim - edge, 0.0) ** 2
            return np.sort(order[:size]), max(low, floor), (aim + edge) ** 2
    return None, 0.0, 0.0


class _Solver:
    """Shift-invert solves of one pencil, sharing the symbolic analysis between shifts."""

    def __init__(self, pencil: PlainPencil, backend: str | Shared | None) -> None:
        self.pencil = pencil
        self.shared = backend if isinstance(backend, Shared) else Shared(Factoriser(backend))
        self._images: tuple[FloatArray, FloatArray, FloatArray] | None = None
        self._at_end: tuple[Factor, float] | None = None
        self.factorisations, self.allowed = 0, RESIDUAL
        self.stiffness_norm, self.mass_norm = self.shared.norms_of(pencil)
        self.norm_ratio = self.stiffness_norm / self.mass_norm

    @cached_property
    def rigid_limit(self) -> float:
        """A floor between rigid-body modes and elastic modes, proven by a count; 0 where nothing moves rigidly."""
        if not self.pencil.rigid_count:
            return 0.0
        counts = []
        for share in RIGID:
            counts.append(self.count_below(share * self.norm_ratio))
            if counts[-1] == self.pencil.rigid_count:
                return share * self.norm_ratio
        raise SolverError(
            f"{counts[0]} eigenvalues were found instead of {self.pencil.rigid_count} rigid-body modes: rounding hides the "
            "lowest modes, because the body is too slender for one solid mesh or its parts are not connected"
        )

    def floor_among(self, values: FloatArray) -> float:
        """Floor as `rigid_limit`, from known eigenvalues: one count proves the gap above the rigid ones."""
        count = self.pencil.rigid_count
        if 0 < count < len(values) and values[count] > 1e3 * abs(values[count - 1]):
            between = float(np.sqrt(max(abs(values[count - 1]), RIGID[-1] * self.norm_ratio) * values[count]))
            if self.count_below(between) == count:
                return between
        return self.rigid_limit

    def factors(self, shift: float, moves: tuple[float, ...]) -> Iterator[tuple[Factor, float]]:
        """Factors of K - shift M, and the shift really used, for each move that is not singular."""

        def counted(matrix: sp.csc_array) -> Factor:
            self.factorisations += 1
            self._at_end = None  # no two factors are held at once
            if self.shared.keeps:
                self.shared.near = None
            return self.shared.factorise(matrix)

        return _factors_near(self.pencil, shift, counted, RIGID[0] * self.norm_ratio, moves)

    def factor(self, shift: float) -> tuple[Factor, float]:
        """Factor of K - shift M, and the shift really used: a singular one is moved."""
        return next(self.factors(shift, COUNTED))

    def count_below(self, shift: float) -> int:
        """Eigenvalues below a shift, rigid ones included."""
        if shift not in self.shared.counts:
            self._at_end = self.factor(shift)
            self.shared.counts[shift] = self._at_end[0].negative
        return self.shared.counts[shift]

    def nearest(self, target: float, count: int) -> tuple[FloatArray, FloatArray]:
        """About `count` eigenpairs nearest to the target, ascending; no promise of completeness.

        On an eigenvalue, to rounding, a solve is that eigenvector and noise: the shift is moved until a pair is clean.
        """
        if count >= self.pencil.dof - 1:
            return self._dense()
        # near 0 Hz the shift lies between rigid and elastic modes: anything relative to the norms may lie far beyond both
        for factor, shift in self.factors(target if target > 0.0 else self.rigid_limit, SEARCHED):
            values, vectors = self.lanczos(factor.solve, shift, count)
            if (self.residual(values, vectors) <= CLEAN_RESIDUAL).any():
                break
        return values, vectors

    def _dense(self) -> tuple[FloatArray, FloatArray]:
        from scipy.linalg import eigh

        values, vectors = eigh(self.pencil.stiffness.toarray(), self.pencil.mass.toarray())
        return values, vectors

    def lanczos(self, solve: Operator, shift: float, count: int) -> tuple[FloatArray, FloatArray]:
        """`count` eigenpairs nearest to the shift, ascending; pairs that rounding disturbed are found again.

        A solve's rounding grows with the largest 1 / |lambda - shift|. For a shift just above the rigid-body modes, or on
        a mode, that is millions of times the one of the other pairs, and they lose as many digits. The pairs without
        such a loss are kept and projected out, so that they disturb the others no more (parlett1998, chapter 5).
        """
        values, vectors = self._krylov(solve, shift, count)
        for _ in range(PASSES):
            clean = self.residual(values, vectors) <= CLEAN_RESIDUAL
            if clean.all() or not clean.any():
                break
            kept = vectors[:, clean]
            more, missing = self._krylov(self.pencil.without(solve, kept), shift, count - kept.shape[1])
            values, vectors = _ascending(np.append(values[clean], more), np.hstack([kept, missing]))
        return values, vectors

    def images(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """K x and M x, (dof, k) each; kept for the last vectors, since for many columns they cost as much as a solve."""
        if self._images is None or self._images[0] is not vectors:
            self._images = vectors, np.asarray(self.pencil.stiffness @ vectors), self.pencil.apply_mass(vectors)
        return self._images[1:]

    def _taken(self, vectors: FloatArray, which: IntArray | BoolArray) -> FloatArray:
        """Columns of the vectors, their images with them."""
        stiff, heavy = self.images(vectors)
        self._images = vectors[:, which], stiff[:, which], heavy[:, which]
        return self._images[0]

    def residual(self, values: FloatArray, vectors: FloatArray) -> FloatArray:
        """Residuals ||K x - l M x|| / (||K|| ||x||), one per pair, shape (k,)."""
        if not len(values):
            return np.empty(0)
        stiff, heavy = self.images(vectors)
        length = self.stiffness_norm * np.linalg.norm(vectors, axis=0)
        return np.asarray(np.linalg.norm(stiff - heavy * values, axis=0) / length)

    def _krylov(self, solve: Operator, shift: float, count: int) -> tuple[FloatArray, FloatArray]:
        """`count` eigenpairs nearest to the shift, ascending, from a fixed start vector."""
        size = self.pencil.dof
        converged = block_lanczos(solve, self.pencil.apply_mass, size, count) if Basis.fits(size, count) else None
        if converged is not None:
            return self._quotients(converged[1])
        basis = min(size, max(2 * count + 1, count + 32))
        shape = (size, size)
        mass = LinearOperator(shape, matvec=self.pencil.apply_mass, dtype=np.float64)
        inverse = LinearOperator(shape, matvec=solve, dtype=np.float64)
        start = np.cos(np.arange(size) * 1.618) + 0.5 * np.sin(np.arange(size) * 0.7)
        try:
            _, vectors = eigsh(
                self.pencil.stiffness, count, mass, sigma=shift, OPinv=inverse, v0=start, ncv=basis, tol=0.0
            )
        except ArpackNoConvergence as fault:
            raise SolverError(
                f"Lanczos found {len(fault.eigenvalues)} of {count} modes; request fewer modes, or a band"
            ) from fault
        return self._quotients(vectors)

    def _quotients(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rayleigh quotients x'Kx / x'Mx and vectors, ascending: a solve's error enters squared (parlett1998, chapter 4)."""
        stiff, heavy = (np.einsum("ik,ik->k", vectors, image) for image in self.images(vectors))
        order = np.argsort(stiff / heavy, kind="stable")
        return (stiff / heavy)[order], self._taken(vectors, order)

    def between(self, low: float, high: float, below_low: int, below_high: int) -> tuple[FloatArray, FloatArray]:
        """Every eigenpair in [low, high], by as many shifts as the number of pairs needs."""
        expected = below_high - below_low
        if expected <= 0:
            return np.empty(0), np.empty((self.pencil.dof, 0))
        if self.shared.guess is not None and (near := self._from_guess(low, high, expected)):
            return near
        if expected > Basis.slice_of(self.pencil.dof):
            return self._halves(low, high, below_low, below_high)
        # half-way in lambda: the pairs nearest to the shift are then those of the band, not those below it
        shifts = self.factors(0.5 * (low + high), SEARCHED)
        if self.shared.static is not None and below_low == 0:
            shifts = chain([(self.shared.static, 0.0)], shifts)
        elif expected <= FEW and (pairs := self._from_the_end(low, high, expected)):
            return pairs
        for factor, shift in shifts:
            values, vectors = self._inside(factor.solve, shift, low, high, expected + max(4, expected // 10))
            for _ in range(3):
                if len(values) >= expected:
                    break
                values, vectors = self._missing(factor, shift, low, high, values, vectors, expected)
            if len(values) == expected and (self.residual(values, vectors) <= RESIDUAL).all():
                self.shared.near = (factor, shift) if self.shared.keeps else None
                break
        if len(values) != expected:
            raise CountMismatch(self._mismatch(low, high, expected, len(values)))
        return values, vectors

    def _from_guess(self, low: float, high: float, expected: int) -> tuple[FloatArray, FloatArray] | None:
        """The pairs of an interval from motions near them; None where these do not lead to all of them."""
        guess, self.shared.guess = self.shared.guess, None
        assert guess is not None
        factor, shift = next(self.factors(0.5 * (low + high), SEARCHED))
        values, vectors = followed(self.pencil, guess, factor.solve, (low, high), FOLLOWED * self.stiffness_norm)
        if len(values) != expected or not (self.residual(values, vectors) <= FOLLOWED).all():
            return None
        self.allowed = FOLLOWED
        self.shared.near = (factor, shift) if self.shared.keeps else None
        return values, vectors

    def _from_the_end(self, low: float, high: float, expected: int) -> tuple[FloatArray, FloatArray] | None:
        """The few pairs of a narrow interval by the factor that counted at its end; None where they are not all clean."""
        if self._at_end is None:
            return None
        factor, shift = self._at_end
        values, vectors = self._inside(factor.solve, shift, low, high, 2 * expected + 4)
        clean = len(values) == expected and (self.residual(values, vectors) <= CLEAN_RESIDUAL).all()
        return (values, vectors) if clean else None

    def _inside(
        self, solve: Operator, shift: float, low: float, high: float, count: int
    ) -> tuple[FloatArray, FloatArray]:
        if count >= self.pencil.dof - 1:
            values, vectors = self._dense()
        else:
            values, vectors = self.lanczos(solve, shift, count)
        keep = (values >= low) & (values <= high)
        return values[keep], self._taken(vectors, keep)

    def _missing(
        self,
        factor: Factor,
        shift: float,
        low: float,
        high: float,
        values: FloatArray,
        vectors: FloatArray,
        expected: int,
    ) -> tuple[FloatArray, FloatArray]:
        """Second pass: solve again with the modes found projected out, so that lost members of clusters appear."""
        more, missing = self._inside(
            self.pencil.without(factor.solve, vectors), shift, low, high, expected - len(values) + 6
        )
        fresh = np.linalg.norm(vectors.T @ self.pencil.apply_mass(missing), axis=0) < 0.5
        return _ascending(np.append(values, more[fresh]), np.hstack([vectors, missing[:, fresh]]))

    def _halves(self, low: float, high: float, below_low: int, below_high: int) -> tuple[FloatArray, FloatArray]:
        """Split at a count-balancing shift: bisect until each part holds a fair share."""
        left, right = max(low, 0.0), high
        for _ in range(8):
            middle = ((left**0.5 + right**0.5) / 2.0) ** 2  # half-way in frequency
            below = self.count_below(middle)
            share = (below - below_low) / (below_high - below_low)
            if 0.25 <= share <= 0.75:
                break
            left, right = (middle, right) if share < 0.25 else (left, middle)
        first = self.between(low, middle, below_low, below)
        second = self.between(middle, high, below, below_high)
        return np.append(first[0], second[0]), np.hstack([first[1], second[1]])

    def _mismatch(self, low: float, high: float, expected: int, computed: int) -> str:
        ends = self.pencil.scale.frequency(np.array([low, high]))
        return (
            f"{computed} modes found between {ends[0]:.1f} and {ends[1]:.1f} Hz, but the inertia count is {expected}; "
            "move the ends of the band away from a mode or request a narrower band"
        )

    def verified(self, values: FloatArray, vectors: FloatArray, low: float, high: float, below_low: int) -> Modes:
        """Normalise, check residuals and orthonormality, and attach the count."""
        scale = self.pencil.scale
        residual, heavy = self.residual(values, vectors), self.images(vectors)[1]
        length = np.sqrt(np.einsum("ik,ik->k", vectors, heavy)) if len(values) else np.empty(0)
        vectors, heavy, self._images = vectors / length, heavy / length, None
        gram = np.abs(vectors.T @ heavy - np.eye(len(values))).max(initial=0.0)
        if residual.max(initial=0.0) > self.allowed or gram > ORTHONORMAL:
            raise SolverError(
                f"residual {residual.max(initial=0.0):.1e} (allowed {self.allowed:.0e}), "
                f"orthonormality {gram:.1e} (allowed {ORTHONORMAL:.0e}): refine the mesh or move the band"
            )
        rounding = self._rounding(values, vectors)
        ends = scale.frequency(np.array([low, high]))
        expected = self.count_below(high) - below_low
        count = Count(float(ends[0]), float(ends[1]), expected, len(values), below_low)
        if expected != len(values):
            raise CountMismatch(self._mismatch(low, high, expected, len(values)))
        frequency = scale.frequency(values)
        return Modes(frequency, vectors, residual, rounding, count, self.pencil.rigid_count, self.factorisations)

    def _rounding(self, values: FloatArray, vectors: FloatArray) -> FloatArray:
        """Relative round-off of each mode, eps |x|'|K||x| / (2 lambda), to first order. Raises SolverError if too large.

        2 |x_i x_j| <= x_i^2 + x_j^2 bounds it by the columns' sums alone, which stand for it where they are small enough.
        """
        if not len(values):
            return np.empty(0)
        share, size = EPSILON / (2.0 * np.abs(values)), np.abs(vectors)
        bound = share * (_column_sums(self.pencil.stiffness) @ size**2)
        if bound.max() <= SLIGHT:
            return np.asarray(bound)
        rounding = share * np.einsum("ik,ik->k", size, abs(self.pencil.stiffness) @ size)
        if rounding.max() > MAX_ROUND_OFF:
            raise SolverError(
                f"rounding alone changes a frequency by {100.0 * rounding.max():.2g} % (limit {100.0 * MAX_ROUND_OFF:.0f} %): "
                "the body is too slender, or its materials differ too much, for a single solid mesh; use plate or beam theory"
            )
        return np.asarray(rounding)


def _ascending(values: FloatArray, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]
