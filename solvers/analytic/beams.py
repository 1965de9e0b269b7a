"""Beams by Euler-Bernoulli and Timoshenko: exact frequencies and shapes, elements of layered, Ritz for tapered ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, islice, pairwise, takewhile
from itertools import count as numbers
from math import inf, isfinite, pi, sqrt
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import Material
from solvers.errors import SolverError, check_above_zero

MAX_COUNT = 200
End = Literal["clamped", "pinned", "sliding", "free"]

# the derivatives of w that vanish: w = 0 deflection, 1 slope, 2 moment, 3 shear force
VANISHING: dict[str, tuple[int, int]] = {"clamped": (0, 1), "pinned": (0, 2), "sliding": (1, 3), "free": (2, 3)}

LOWEST = 0.5  # below the smallest root of any pair (pi/2), above the trivial one
STEP = pi / 16.0  # roots of one pair lie about pi apart
BRACKETED = 16  # from the root of this number on, near 50, exp(-beta L) is below rounding and roots lie pi apart
PANEL, PANEL_PHASE = np.polynomial.legendre.leggauss(16), 4.0  # span of kappa s per Gauss rule: exact to rounding

ENOUGH = 14  # polynomial degree beyond twice the mode number; the series converges exponentially
LOWEST_SCANNED = 0.3  # smallest bending wavenumber times L scanned, below the smallest root of any pair (about pi/2)
REFINE = 1e-6  # relative half width of the interval around a Ritz frequency searched for the exact root


@dataclass(frozen=True)
class BeamMode:
    """One mode: phi(s) = sum of coefficients times basis, s = x/L in [0, 1], mean of phi^2 equal to 1.

    kappa is beta L, dimensionless; 0 marks a rigid-body mode. Source: blevins1979.
    """

    kappa: float
    coefficients: tuple[float, float, float, float]

    def shape(self, s: ArrayLike, derivative: int = 0) -> FloatArray:
        """d^n phi/ds^n at s, the shape of s; dimensionless."""
        return np.asarray(_basis(self.kappa, np.asarray(s, dtype=float), derivative) @ np.array(self.coefficients))


@dataclass(frozen=True)
class BeamMatrices:
    """K over (u, w) and M over w. nodes_m (n + 1,); u has 2 n + 1 degrees of freedom, w has (w, w') at each node.

    stretching (u, u), coupling (u, w), bending (w, w), mass (w, w).
    """

    nodes_m: FloatArray
    stretching: FloatArray
    coupling: FloatArray
    bending: FloatArray
    mass: FloatArray


@dataclass(frozen=True)
class EndBody:
    """A rigid body on a beam's end: mass, rotary inertia about its own centre, how far that lies beyond the end. SI."""

    mass_kg: float
    inertia_kg_m2: float
    arm_m: float


@dataclass(frozen=True)
class Beam:
    """A beam in bending, SI. width_ratio(s), s = x/L, scales every section size against the one at s = 0; `end` is carried
    at s = 1.

    length_m L; bending_n_m2 EI, shear_n kappa G A, mass_kg_m rho A, rotary_kg_m rho I, all at s = 0.
    """

    length_m: float
    bending_n_m2: float
    shear_n: float
    mass_kg_m: float
    rotary_kg_m: float
    width_ratio: Callable[[FloatArray], FloatArray] | None = None
    end: EndBody | None = None

    @property
    def flexibility(self) -> float:
        """E I/(kappa G A L^2), dimensionless: 0 is Euler-Bernoulli's beam."""
        return self.bending_n_m2 / (self.shear_n * self.length_m**2)

    @property
    def rotation(self) -> float:
        """I/(A L^2), dimensionless: rotary inertia."""
        return self.rotary_kg_m / (self.mass_kg_m * self.length_m**2)

    @property
    def end_shares(self) -> tuple[float, float, float]:
        """The end body's mass over rho A L, its inertia over rho A L^3 and its arm over L; zeros without one."""
        if self.end is None:
            return 0.0, 0.0, 0.0
        mass = self.mass_kg_m * self.length_m
        return self.end.mass_kg / mass, self.end.inertia_kg_m2 / mass / self.length_m**2, self.end.arm_m / self.length_m

    @property
    def unit_rad_s(self) -> float:
        """sqrt(EI/(rho A L^4)), rad/s: omega over this is the dimensionless frequency."""
        return sqrt(self.bending_n_m2 / self.mass_kg_m) / self.length_m**2


def root_between(
    function: Callable[[float], float], low: float, high: float, xtol: float, rtol: float = 4e-16
) -> float:
    """Find a root between two ends where f changes its sign, by inverse quadratic steps or else halving.

    Parameters
    ----------
    function : callable
        f at a float.
    low, high : float
        The ends, in the unit of the argument.
    xtol, rtol : float
        The root lies within xtol + rtol |x|: absolute in that unit, and relative.

    Returns
    -------
    float
        The root, in the unit of the ends.

    Raises
    ------
    SolverError
        If f has the same sign at both ends, a value is not finite, or no root is found within MAX_COUNT steps.

    References
    ----------
    .. [1] chandrupatla1997 (docs/references.bib)
    """
    a, b = float(high), float(low)
    fa, fb = function(a), function(b)
    if not (isfinite(fa) and isfinite(fb)) or (fa != 0.0 and fb != 0.0 and (fa < 0.0) == (fb < 0.0)):
        raise SolverError(f"no sign change between {low:g} and {high:g}: {fb:g} and {fa:g}")
    c, fc, share = a, fa, 0.5
    for _ in range(MAX_COUNT):
        best, value = (a, fa) if abs(fa) < abs(fb) else (b, fb)
        least = (xtol + rtol * abs(best)) / 2.0 / abs(a - b)
        if value == 0.0 or least > 0.5:
            return best
        x = a + min(max(share, least), 1.0 - least) * (b - a)
        fx = function(x)
        if not isfinite(fx):
            raise SolverError(f"no finite value at {x:g}, between {low:g} and {high:g}")
        if (fx < 0.0) == (fa < 0.0):
            c, fc = a, fa
        else:
            c, fc, b, fb = b, fb, a, fa
        a, fa = x, fx
        share = _inverse_quadratic(a, b, c, fa, fb, fc)
    raise SolverError(f"no root within {xtol:g} between {low:g} and {high:g} after {MAX_COUNT} steps")


def roots_along(function: Callable[[float], float], grid: Iterable[float], xtol: float) -> Iterator[float]:
    """Find the roots in those steps of an ascending grid over which a function changes its sign.

    Parameters
    ----------
    function : callable
        f at a float.
    grid : iterable of float
        Ascending arguments, in any unit.
    xtol : float
        Absolute accuracy of a root, in the unit of the grid.

    Yields
    ------
    float
        A root, in the unit of the grid.
    """
    for (low, at_low), (high, at_high) in pairwise((float(x), function(float(x))) for x in grid):
        if (at_low < 0.0) != (at_high < 0.0):
            yield root_between(function, low, high, xtol)


def _check_ends(*ends: str) -> None:
    """Raise SolverError if an end condition is not clamped, pinned, sliding or free."""
    for end in ends:
        if end not in VANISHING:
            raise SolverError(f"end condition {end!r}: must be one of {', '.join(VANISHING)}")


def roots(left: End, right: End, count: int) -> tuple[float, ...]:
    """Compute the first values of beta L above 0 from sign changes of the determinant of the end conditions.

    Parameters
    ----------
    left, right : str
        End conditions.
    count : int
        Number of values.

    Returns
    -------
    tuple of float
        `count` values of beta L, ascending, dimensionless.

    Raises
    ------
    SolverError
        For an unknown end condition or a negative count.
    """
    _check_ends(left, right)
    if count < 0:
        raise SolverError(f"count = {count}: must be 0 or more")
    return _first_roots(left, right, 1 << max(count - 1, 3).bit_length())[:count]


@lru_cache(maxsize=512)
def beam_mode(left: End, right: End, number: int) -> BeamMode:
    """Compute an elastic mode of a beam; its deflection at s = 1 is positive.

    Parameters
    ----------
    left, right : str
        End conditions.
    number : int
        Number of the mode, from 1.

    Returns
    -------
    BeamMode
        The shape over s in [0, 1].

    Raises
    ------
    SolverError
        For a number below 1 or an unknown end condition.
    """
    if number < 1:
        raise SolverError(f"mode number {number}: must be 1 or more")
    kappa = roots(left, right, number)[-1]
    return _normalised(kappa, np.linalg.svd(_end_matrix(kappa, left, right))[2][-1])


def free_free_mode(nodes: int) -> BeamMode:
    """Compute the free-free shape with a number of nodes: 0 and 1 are rigid-body modes, N is elastic mode N - 1.

    Parameters
    ----------
    nodes : int
        N.

    Returns
    -------
    BeamMode
        The shape over s in [0, 1].

    Raises
    ------
    SolverError
        For a negative number.
    """
    if nodes < 0:
        raise SolverError(f"nodal lines = {nodes}: must be 0 or more")
    if nodes < 2:
        return _normalised(0.0, np.array([1.0, 0.0, 0.0, 0.0]) if nodes == 0 else np.array([0.0, 1.0, 0.0, 0.0]))
    return beam_mode("free", "free", nodes - 1)


def zone_mode(nodes: int, pinned_low: bool = False, pinned_high: bool = False) -> BeamMode:
    """Compute the shape along a zone with a number of nodes between its ends, each of which is free or pinned.

    Parameters
    ----------
    nodes : int
        N.
    pinned_low, pinned_high : bool, optional
        Whether the end at s = 0, or at s = 1, is pinned.

    Returns
    -------
    BeamMode
        The shape over s in [0, 1].

    Raises
    ------
    SolverError
        For a negative number.
    """
    if not (pinned_low or pinned_high):
        return free_free_mode(nodes)
    if nodes < 0:
        raise SolverError(f"nodal lines = {nodes}: must be 0 or more")
    if pinned_low and pinned_high:
        return beam_mode("pinned", "pinned", nodes + 1)
    if nodes:
        return beam_mode("pinned", "free", nodes) if pinned_low else beam_mode("free", "pinned", nodes)
    return _normalised(0.0, np.array([0.0, 1.0, 0.0, 0.0] if pinned_low else [1.0, -1.0, 0.0, 0.0]))


@lru_cache(maxsize=512)
def antinodes(mode: BeamMode) -> tuple[float, ...]:
    """Find the inner extrema of a shape from sign changes of its slope.

    Parameters
    ----------
    mode : BeamMode
        The shape.

    Returns
    -------
    tuple of float
        s in (0, 1), ascending, dimensionless.
    """
    if mode.kappa == 0.0:
        return ()
    grid = np.linspace(0.0, 1.0, 32 * (int(mode.kappa / pi) + 2) + 1)[1:-1]
    return tuple(roots_along(lambda s: float(mode.shape(s, 1)), grid, 1e-14))


def frequency_hz(kappa: FloatArray, length_m: float, bending_n_m2: float, mass_kg_m: float) -> FloatArray:
    """Compute f = kappa^2/(2 pi L^2) sqrt(EI/(rho A)).

    Parameters
    ----------
    kappa : ndarray, any shape
        beta L of the modes.
    length_m : float
        L.
    bending_n_m2 : float
        EI, in N m^2.
    mass_kg_m : float
        rho A, in kg/m.

    Returns
    -------
    ndarray, shape of kappa
        In Hz.
    """
    return kappa**2 / (2.0 * pi * length_m**2) * sqrt(bending_n_m2 / mass_kg_m)


def hermite(s: FloatArray, length_m: FloatArray | float, derivative: int = 0) -> FloatArray:
    """Evaluate the cubic shape functions of (w1, w1', w2, w2'), or their derivatives over x.

    Parameters
    ----------
    s : ndarray, shape (...)
        x/length, in [0, 1].
    length_m : float or ndarray, shape (...)
        Length of the element.
    derivative : int, optional
        Order of the derivative.

    Returns
    -------
    ndarray, shape (..., 4)
        Values per unit of each nodal value.
    """
    cubic = np.polynomial.Polynomial
    shapes = [cubic([1, 0, -3, 2]), cubic([0, 1, -2, 1]), cubic([0, 0, 3, -2]), cubic([0, 0, -1, 1])]
    columns = [(shape.deriv(derivative) if derivative else shape)(s) for shape in shapes]
    length = np.asarray(length_m)
    for column in (1, 3):
        columns[column] = columns[column] * length
    return np.asarray(np.stack(columns, axis=-1) / np.asarray(length**derivative)[..., None])


def assemble_beam(nodes_m: FloatArray, sections: FloatArray) -> BeamMatrices:
    """Assemble the matrices of a layered beam by a Gauss rule that is exact for its elements.

    Parameters
    ----------
    nodes_m : ndarray, shape (n + 1,)
        Nodes, ascending.
    sections : ndarray, shape (n, 4)
        EA (N), ES (N m), EI (N m^2) about the beam's middle plane and rho A (kg/m) of each element.

    Returns
    -------
    BeamMatrices
        Stretching, coupling, bending and mass.
    """
    count = len(nodes_m) - 1
    points, weights = legendre.leggauss(4)
    s = (points + 1.0) / 2.0
    stretching, coupling = np.zeros((2 * count + 1,) * 2), np.zeros((2 * count + 1, 2 * count + 2))
    bending, mass = np.zeros((2 * count + 2,) * 2), np.zeros((2 * count + 2,) * 2)
    for e, (length, (ea, es, ei, heavy)) in enumerate(zip(np.diff(nodes_m), sections, strict=True)):
        weight = weights * length / 2.0
        slope = np.stack([4.0 * s - 3.0, 4.0 - 8.0 * s, 4.0 * s - 1.0], axis=-1) / length
        value, curve = hermite(s, float(length)), hermite(s, float(length), 2)
        axial, lateral = slice(2 * e, 2 * e + 3), slice(2 * e, 2 * e + 4)
        stretching[axial, axial] += ea * slope.T @ (weight[:, None] * slope)
        coupling[axial, lateral] -= es * slope.T @ (weight[:, None] * curve)
        bending[lateral, lateral] += ei * curve.T @ (weight[:, None] * curve)
        mass[lateral, lateral] += heavy * value.T @ (weight[:, None] * value)
    return BeamMatrices(nodes_m, stretching, coupling, bending, mass)


def deflection_rows(nodes_m: FloatArray, points_m: FloatArray) -> FloatArray:
    """Interpolate w at points from the nodal (w, w').

    Parameters
    ----------
    nodes_m : ndarray, shape (n,)
        Nodes, ascending.
    points_m : ndarray, shape (points,)
        Places along the beam.

    Returns
    -------
    ndarray, shape (points, 2 n)
        Rows to multiply the nodal values with.
    """
    element = np.clip(np.searchsorted(nodes_m, points_m, side="right") - 1, 0, len(nodes_m) - 2)
    length = np.diff(nodes_m)[element]
    values = hermite((points_m - nodes_m[element]) / length, length)
    rows = np.zeros((len(points_m), 2 * len(nodes_m)))
    rows[np.arange(len(points_m))[:, None], 2 * element[:, None] + np.arange(4)] = values
    return rows


def beam_of(length_m: float, area_m2: float, about_m4: float, shear_factor: float, material: Material) -> Beam:
    """Build a uniform beam along z from its section.

    Parameters
    ----------
    length_m, area_m2, about_m4 : float
        Length in m, area in m^2 and second moment of area in m^4.
    shear_factor : float
        kappa, dimensionless.
    material : Material
        Of the whole beam.

    Returns
    -------
    Beam
        Rigidities and masses per length, in SI units.

    Raises
    ------
    SolverError
        For a size that is not above 0.
    """
    for what, value in (("length", length_m), ("section", min(area_m2, about_m4))):
        check_above_zero(f"beam {what}", value)
    rod, density = material.rod(2), material.density_kg_m3
    shear = shear_factor * rod.shear_pa * area_m2
    return Beam(length_m, rod.young_pa * about_m4, shear, density * area_m2, density * about_m4)


def _check_beam(beam: Beam, count: int) -> None:
    """Raise SolverError unless every size is finite and above 0 and at least one mode is requested."""
    sizes = (beam.length_m, beam.bending_n_m2, beam.shear_n, beam.mass_kg_m, beam.rotary_kg_m)
    if count < 1 or not all(np.isfinite(size) and size > 0.0 for size in sizes):
        raise SolverError(f"beam {sizes}, count {count}: every number must be finite and above 0")


def strained_omegas(strains: FloatArray | ComplexArray, mass: FloatArray | ComplexArray, count: int) -> FloatArray:
    """Compute the lowest frequencies of K x = omega^2 M x with K = B* B, without forming K, which would lose half the digits.

    With B = Q R and M = L L*, 1 / omega are the largest singular values of R*^-1 L; R keeps each column to its own rounding.

    Parameters
    ----------
    strains : ndarray, shape (m, n)
        B: strains times the roots of their stiffness and weight, m >= n, of full rank.
    mass : ndarray, shape (n, n)
        M, positive definite.
    count : int
        Number of frequencies.

    Returns
    -------
    ndarray, shape (count,)
        Ascending.
    """
    from scipy.linalg import cholesky, qr, solve_triangular  # slow to import, and uniform beams need none

    triangle = qr(strains, mode="r", check_finite=False)[0][: strains.shape[1]]
    inverse = solve_triangular(triangle, cholesky(mass, lower=True), trans="C")
    return 1.0 / np.asarray(np.linalg.svd(inverse, compute_uv=False)[:count])


def ritz_frequencies_hz(beam: Beam, left: End, right: End, count: int, rigid_shear: bool = False) -> FloatArray:
    """Compute the first elastic frequencies of a beam by Ritz, from above; `exact_omegas` is exact for uniform beams.

    Minimises integral of EI psi'^2 + kappa G A (w' - psi)^2 over integral of rho A w^2 + rho I psi^2, to which a body on the
    right end adds M (w + d psi)^2 + J psi^2 there.

    Parameters
    ----------
    beam : Beam
        Uniform or tapered, with or without a body on its end.
    left, right : str
        End conditions.
    count : int
        Number of frequencies.
    rigid_shear : bool, optional
        Leave out the beam's shear and rotary inertia (Euler-Bernoulli).

    Returns
    -------
    ndarray, shape (count,)
        In Hz.

    Raises
    ------
    SolverError
        For an unknown end, a count below 1, or a size that is not above 0.
    """
    _check_ends(left, right)
    _check_beam(beam, count)
    if rigid_shear:
        beam = replace(beam, shear_n=inf, rotary_kg_m=0.0)
    return _ritz_omegas(beam, left, right, count) * beam.unit_rad_s / (2.0 * pi)


def _ritz_omegas(beam: Beam, left: End, right: End, count: int) -> FloatArray:
    """Dimensionless elastic frequencies omega sqrt(rho A L^4/EI) by Ritz, ascending, (count,)."""
    from scipy.linalg import null_space  # slow to import, and uniform beams need none

    degree = 2 * count + ENOUGH
    (strains, mass), held = _strains_and_mass(beam, degree), _constraints(beam, left, right, degree)
    still = np.eye(2, held.shape[1])  # w = 1 and w = 2 s - 1, which turns by psi = 2
    rigid = null_space(held @ still.T).T @ still
    basis = null_space(np.vstack([held, rigid @ mass]))
    return strained_omegas(strains @ basis, basis.T @ mass @ basis, count)


def exact_omegas(beam: Beam, left: End, right: End, count: int) -> list[float]:
    """Solve Timoshenko's equations for the first elastic frequencies; rigid-body modes are left out.

    EI psi'' + kappa G A (w' - psi) + rho I omega^2 psi = 0, kappa G A (w'' - psi') + rho A omega^2 w = 0.

    Parameters
    ----------
    beam : Beam
        A uniform beam.
    left, right : str
        End conditions.
    count : int
        Number of frequencies.

    Returns
    -------
    list of float
        Ascending, in units of beam.unit_rad_s.

    Raises
    ------
    SolverError
        For an unknown end, a count below 1, a size that is not above 0, a tapered beam or a body on its end.

    References
    ----------
    .. [1] timoshenko1921 (docs/references.bib)
    """
    _check_ends(left, right)
    _check_beam(beam, count)
    if beam.width_ratio is not None or beam.end is not None:
        raise SolverError("a tapered beam, or one that carries a body, has no exact solution: use ritz_frequencies_hz")
    cutoff = 1.0 / sqrt(beam.flexibility * beam.rotation)
    below = takewhile(lambda omega: omega < cutoff, (_omega_of(LOWEST_SCANNED + STEP * i, beam) for i in numbers()))
    omegas = list(islice(_roots(chain(below, [cutoff * (1.0 - 1e-12)]), beam, left, right), count))
    return omegas if len(omegas) == count else _beyond_cutoff(beam, left, right, count, omegas)


def characteristic(omega: float, beam: Beam, left: str, right: str) -> float:
    """Compute the determinant of the four end conditions; it is 0 at an exact mode.

    lambda^4 + (b + r omega^2) lambda^2 + r omega^2 b - omega^2 = 0, b = flexibility omega^2, r = rotation.

    Parameters
    ----------
    omega : float
        Dimensionless frequency.
    beam : Beam
        A uniform beam.
    left, right : str
        End conditions.

    Returns
    -------
    float
        The determinant, dimensionless.
    """
    return float(np.linalg.det(_timoshenko_end_matrix(omega, beam, left, right)))


def _inverse_quadratic(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Share of the way from a to b where the parabola x(f) through three points has f = 0; half where that is not safe."""
    if fc in (fa, fb):
        return 0.5
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
    if phi**2 >= xi or (1.0 - phi) ** 2 >= 1.0 - xi:
        return 0.5
    return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)


def _basis(kappa: float, s: FloatArray, derivative: int = 0) -> FloatArray:
    """cos, sin, scaled cosh and sinh of kappa (s - 1/2), last axis 4; for kappa = 0 the rigid-body modes 1, 2s - 1."""
    t = s - 0.5
    if kappa == 0.0:
        columns = [np.ones_like(t), 2.0 * t] if derivative == 0 else [np.zeros_like(t), np.full_like(t, 2.0)]
        columns = columns if derivative <= 1 else [np.zeros_like(t)] * 2
        return np.stack([*columns, np.zeros_like(t), np.zeros_like(t)], axis=-1)
    phase = kappa * t + derivative * pi / 2.0
    rising, falling = np.exp(kappa * (t - 0.5)), np.exp(-kappa * (t + 0.5))
    even, odd = (rising + falling) / (1.0 + np.exp(-kappa)), (rising - falling) / (1.0 - np.exp(-kappa))
    if derivative % 2:
        tanh = np.tanh(kappa / 2.0)
        even, odd = odd * tanh, even / tanh
    return kappa**derivative * np.stack([np.cos(phase), np.sin(phase), even, odd], axis=-1)


def _end_matrix(kappa: float, left: str, right: str) -> FloatArray:
    """The four end conditions on the four coefficients, rows scaled by kappa^-n."""
    rows = [_basis(kappa, np.array(s), n) / kappa**n for s, end in ((0.0, left), (1.0, right)) for n in VANISHING[end]]
    return np.stack(rows)


@lru_cache(maxsize=64)
def _first_roots(left: str, right: str, count: int) -> tuple[float, ...]:
    """Bracketed roots; beyond BRACKETED those of trigonometry alone, quarters of pi: the neglected part is below exp(-50)."""
    bracketed = min(count, BRACKETED)
    grid = np.arange(LOWEST, (bracketed + 2) * pi, STEP)
    found = roots_along(lambda kappa: float(np.linalg.det(_end_matrix(kappa, left, right))), grid, 1e-13)
    roots = list(islice(found, bracketed))
    if len(roots) < bracketed:
        raise SolverError(f"{left}-{right} beam: {len(roots)} of {bracketed} roots were found")
    quarters = round(4.0 * roots[-1] / pi)
    return (*roots, *(pi / 4.0 * (quarters + 4 * n) for n in range(1, count - bracketed + 1)))


def _normalised(kappa: float, coefficients: FloatArray) -> BeamMode:
    panels = int(kappa / PANEL_PHASE) + 1
    s = ((PANEL[0] + 1.0) / 2.0 + np.arange(panels)[:, None]).ravel() / panels
    phi = _basis(kappa, s) @ coefficients
    scale = sqrt(float(np.tile(PANEL[1], panels) @ phi**2) / 2.0 / panels)
    tip = float(_basis(kappa, np.array(1.0)) @ coefficients)
    turn = float(_basis(kappa, np.array(1.0), 1) @ coefficients)
    sign = np.sign(tip) if abs(tip) > 1e-6 * scale else -np.sign(turn) or 1.0
    a, b, c, d = coefficients * (float(sign) / scale)
    return BeamMode(kappa, (float(a), float(b), float(c), float(d)))


def _rows(points: FloatArray, beam: Beam, degree: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """w, psi, psi' and g at the points as rows over (w, g) coefficients; psi = w' - flexibility g."""
    value: FloatArray = np.asarray(legendre.legvander(points, degree), dtype=np.float64)
    series = np.eye(degree + 1)
    slope: FloatArray = np.asarray(2.0 * legendre.legval(points, legendre.legder(series)).T, dtype=np.float64)
    curve: FloatArray = np.asarray(4.0 * legendre.legval(points, legendre.legder(series, 2)).T, dtype=np.float64)
    zero, flex = np.zeros_like(value), beam.flexibility
    if flex == 0.0:
        return value, slope, curve, zero
    return (
        np.hstack([value, zero]),
        np.hstack([slope, -flex * value]),
        np.hstack([curve, -flex * slope]),
        np.hstack([zero, value]),
    )


def _strains_and_mass(beam: Beam, degree: int) -> tuple[FloatArray, FloatArray]:
    """B, whose rows are curvature and shear at points times the roots of their stiffness and weight, and M."""
    points, weights = legendre.leggauss(degree + 12)
    ratio = np.ones_like(points) if beam.width_ratio is None else beam.width_ratio((points + 1.0) / 2.0)
    area, bent = weights / 2.0 * ratio**2, weights / 2.0 * ratio**4
    deflection, rotation, bending, shear = _rows(points, beam, degree)
    strains = np.vstack([np.sqrt(bent)[:, None] * bending, np.sqrt(area * beam.flexibility)[:, None] * shear])
    mass = _gram(deflection, area) + _gram(rotation, bent * beam.rotation)
    heavy, turned, arm = beam.end_shares
    deflection, rotation, _, _ = _rows(np.array([1.0]), beam, degree)
    return strains, mass + _gram(deflection + arm * rotation, np.array([heavy])) + _gram(rotation, np.array([turned]))


def _gram(rows: FloatArray, weights: FloatArray) -> FloatArray:
    return np.asarray(rows.T @ (weights[:, None] * rows))


def _constraints(beam: Beam, left: str, right: str, degree: int) -> FloatArray:
    """Rows that hold w (clamped, pinned) and psi (clamped, sliding) at the ends; the energy gives the rest."""
    rows = [np.zeros((degree + 1) * (1 if beam.flexibility == 0.0 else 2))]
    for end, at in ((left, -1.0), (right, 1.0)):
        deflection, rotation, _, _ = (row[0] for row in _rows(np.array([at]), beam, degree))
        rows += [deflection] if end in ("clamped", "pinned") else []
        rows += [rotation] if end in ("clamped", "sliding") else []
    return np.stack(rows)


def _omega_of(wavenumber: float, beam: Beam) -> float:
    """Dimensionless frequency of the bending wave of this wavenumber times L."""
    flex, turn, square = beam.flexibility, beam.rotation, wavenumber**2
    p = (flex + turn) * square + 1.0
    return sqrt(2.0 * square**2 / (p + sqrt(p**2 - 4.0 * flex * turn * square**2)))


def _roots(omegas: Iterable[float], beam: Beam, left: str, right: str) -> Iterator[float]:
    return roots_along(lambda omega: characteristic(omega, beam, left, right), omegas, 1e-14)


def _beyond_cutoff(beam: Beam, left: End, right: End, count: int, below: list[float]) -> list[float]:
    """The first `count` roots when some lie above the cut-off: Ritz estimates, refined where a root is alone."""
    estimates = _ritz_omegas(beam, left, right, count)
    refined = list(below)
    for estimate in estimates[len(below) :]:
        around = estimate * np.array([1.0 - REFINE, 1.0 + REFINE])
        refined.append(next(_roots(around, beam, left, right), float(estimate)))
    return refined


def _timoshenko_end_matrix(omega: float, beam: Beam, left: str, right: str) -> FloatArray:
    basis = _basis_of(omega, beam)
    rows = []
    for t, end in ((-0.5, left), (0.5, right)):
        deflection, rotation, moment, shear = basis(t)
        rows.append(deflection if end in ("clamped", "pinned") else shear)
        rows.append(rotation if end in ("clamped", "sliding") else moment)
    matrix = np.stack(rows)
    return np.asarray(matrix / np.linalg.norm(matrix, axis=1, keepdims=True))


def _basis_of(omega: float, beam: Beam) -> Callable[[float], tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """w, psi, psi' and (w' - psi)/b of the four exact solutions as a function of t = s - 1/2.

    Two solutions have wavenumber^2 = trig, two lambda^2 = other; these are scaled to one at the ends.
    """
    b, turn = beam.flexibility * omega**2, beam.rotation * omega**2
    half, product = (b + turn) / 2.0, turn * b - omega**2
    trig = half + sqrt(half**2 - product)
    other = -product / trig
    a, root = sqrt(trig), sqrt(abs(other))

    def at(t: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        c, s = np.cos(a * t), np.sin(a * t) / a
        even, odd = _hyperbolic(root, t) if other >= 0.0 else (np.cos(root * t), np.sin(root * t))
        over = odd / root if root > 0.0 else t
        deflection = np.array([c, s, even, other * over])
        rotation = np.array([(b - trig) * s, (1.0 - b / trig) * c, (other + b) * over, (other + b) * even])
        moment = np.array([(b - trig) * c, (b - trig) * s, (other + b) * even, (other + b) * other * over])
        return deflection, rotation, moment, np.array([-s, c / trig, -over, -even])

    return at


def _hyperbolic(root: float, t: float) -> tuple[float, float]:
    """cosh and sinh of root t over cosh(root/2), by decaying exponentials only."""
    rising, falling = np.exp(root * (abs(t) - 0.5)), np.exp(-root * (abs(t) + 0.5))
    scale = 1.0 + np.exp(-root)
    return float((rising + falling) / scale), float(np.sign(t) * (rising - falling) / scale)
