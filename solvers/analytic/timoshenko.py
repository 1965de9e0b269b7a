"""Timoshenko beams: sections, exact frequencies of uniform ones, and Rayleigh-Ritz for tapered ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice, takewhile
from itertools import count as numbers
from math import inf, pi, sqrt

import numpy as np
from numpy.polynomial import legendre

from geometry.elements import FloatArray
from geometry.materials import Material
from solvers.analytic.beams import End, check_ends, rigid_count, roots_along
from solvers.errors import SolverError, check_above_zero

# -- sections ----------------------------------------------------------------------------------------------------------
# A beam's section as Timoshenko's theory takes it: its stiffnesses and inertias.


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


def beam_of(length_m: float, area_m2: float, about_m4: float, shear_factor: float, material: Material) -> Beam:
    """A uniform beam along z from its section's area, second moment and shear factor.

    Raises SolverError for a size that is not above 0.
    """
    for what, value in (("length", length_m), ("section", min(area_m2, about_m4))):
        check_above_zero(f"beam {what}", value)
    rod, density = material.rod(2), material.density_kg_m3
    shear = shear_factor * rod.shear_pa * area_m2
    return Beam(length_m, rod.young_pa * about_m4, shear, density * area_m2, density * about_m4)


def check_beam(beam: Beam, count: int) -> None:
    """SolverError unless every size is finite and above 0 and at least one mode is asked."""
    sizes = (beam.length_m, beam.bending_n_m2, beam.shear_n, beam.mass_kg_m, beam.rotary_kg_m)
    if count < 1 or not all(np.isfinite(size) and size > 0.0 for size in sizes):
        raise SolverError(f"beam {sizes}, count {count}: every number must be finite and above 0")


# -- Rayleigh-Ritz -----------------------------------------------------------------------------------------------------
# Rayleigh-Ritz for Timoshenko beams, tapered ones included: Legendre series for deflection and shear angle.
# With the shear angle over the flexibility as second unknown the matrices stay well scaled for any slenderness.

ENOUGH = 14  # polynomial degree beyond twice the mode number; the series converges exponentially


def ritz_frequencies_hz(beam: Beam, left: End, right: End, count: int, rigid_shear: bool = False) -> FloatArray:
    """The first `count` elastic frequencies from above, Hz; for uniform beams exact_omegas is exact.

    Minimises integral of EI psi'^2 + kappa G A (w' - psi)^2 over integral of rho A w^2 + rho I psi^2, to which a body on the
    right end adds M (w + d psi)^2 + J psi^2 there; rigid_shear leaves the beam's shear and rotary inertia out
    (Euler-Bernoulli). SolverError as exact_omegas.
    """
    check_ends(left, right)
    check_beam(beam, count)
    if rigid_shear:
        beam = replace(beam, shear_n=inf, rotary_kg_m=0.0)
    return ritz_omegas(beam, left, right, count) * beam.unit_rad_s / (2.0 * pi)


def ritz_omegas(beam: Beam, left: End, right: End, count: int) -> FloatArray:
    """Dimensionless elastic frequencies omega sqrt(rho A L^4/EI), shape (count,)."""
    degree = 2 * count + ENOUGH
    stiffness, mass = _matrices(beam, degree)
    from scipy.linalg import eigh, null_space  # slow to import, and uniform beams need none

    basis = null_space(_constraints(beam, left, right, degree))
    values = eigh(basis.T @ stiffness @ basis, basis.T @ mass @ basis, eigvals_only=True)
    rigid = rigid_count(left, right)
    return np.sqrt(np.abs(values[rigid : rigid + count]))


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


def _matrices(beam: Beam, degree: int) -> tuple[FloatArray, FloatArray]:
    points, weights = legendre.leggauss(degree + 12)
    ratio = np.ones_like(points) if beam.width_ratio is None else beam.width_ratio((points + 1.0) / 2.0)
    deflection, rotation, bending, shear = _rows(points, beam, degree)
    stiffness = _gram(bending, weights * ratio**4) + _gram(shear, weights * ratio**2 * beam.flexibility)
    mass = _gram(deflection, weights * ratio**2) + _gram(rotation, weights * ratio**4 * beam.rotation)
    heavy, turned, arm = beam.end_shares
    deflection, rotation, _, _ = _rows(np.array([1.0]), beam, degree)
    at_end = _gram(deflection + arm * rotation, np.array([heavy])) + _gram(rotation, np.array([turned]))
    return stiffness / 2.0, mass / 2.0 + at_end


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


# -- exact frequencies -------------------------------------------------------------------------------------------------
# Uniform Timoshenko beams: exact frequencies for every pair of end conditions.
# Below the thickness-shear cut-off the roots lie about pi apart in the bending wavenumber and are bracketed by a
# scan; above it two families interleave, and a Rayleigh-Ritz solution tells where to look.

LOWEST = 0.3  # smallest bending wavenumber times L scanned, below the smallest root of any pair (about pi/2)
STEP = pi / 16.0
REFINE = 1e-6  # relative half width of the interval around a Ritz frequency searched for the exact root


def exact_omegas(beam: Beam, left: End, right: End, count: int) -> list[float]:
    """The first `count` elastic frequencies in units of beam.unit_rad_s; rigid-body modes are left out.

    EI psi'' + kappa G A (w' - psi) + rho I omega^2 psi = 0, kappa G A (w'' - psi') + rho A omega^2 w = 0.
    Raises SolverError for an unknown end, count < 1, a size that is not above 0, a tapered beam or a body on its end.
    Source: timoshenko1921.
    """
    check_ends(left, right)
    check_beam(beam, count)
    if beam.width_ratio is not None or beam.end is not None:
        raise SolverError("a tapered beam, or one that carries a body, has no exact solution: use ritz_frequencies_hz")
    cutoff = 1.0 / sqrt(beam.flexibility * beam.rotation)
    below = takewhile(lambda omega: omega < cutoff, (_omega_of(LOWEST + STEP * i, beam) for i in numbers()))
    omegas = list(islice(_roots(chain(below, [cutoff * (1.0 - 1e-12)]), beam, left, right), count))
    return omegas if len(omegas) == count else _beyond_cutoff(beam, left, right, count, omegas)


def _omega_of(wavenumber: float, beam: Beam) -> float:
    """Dimensionless frequency of the bending wave of this wavenumber times L."""
    flex, turn, square = beam.flexibility, beam.rotation, wavenumber**2
    p = (flex + turn) * square + 1.0
    return sqrt(2.0 * square**2 / (p + sqrt(p**2 - 4.0 * flex * turn * square**2)))


def _roots(omegas: Iterable[float], beam: Beam, left: str, right: str) -> Iterator[float]:
    return roots_along(lambda omega: characteristic(omega, beam, left, right), omegas, 1e-14)


def _beyond_cutoff(beam: Beam, left: End, right: End, count: int, below: list[float]) -> list[float]:
    """The first `count` roots when some lie above the cut-off: Ritz estimates, refined where a root is alone."""

    estimates = ritz_omegas(beam, left, right, count)
    refined = list(below)
    for estimate in estimates[len(below) :]:
        around = estimate * np.array([1.0 - REFINE, 1.0 + REFINE])
        refined.append(next(_roots(around, beam, left, right), float(estimate)))
    return refined


def characteristic(omega: float, beam: Beam, left: str, right: str) -> float:
    """Determinant of the four end conditions at the dimensionless frequency omega; 0 at an exact mode.

    lambda^4 + (b + r omega^2) lambda^2 + r omega^2 b - omega^2 = 0, b = flexibility omega^2, r = rotation.
    """
    return float(np.linalg.det(_end_matrix(omega, beam, left, right)))


def _end_matrix(omega: float, beam: Beam, left: str, right: str) -> FloatArray:
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
