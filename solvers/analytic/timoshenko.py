"""Uniform Timoshenko beams: exact frequencies for every pair of end conditions.

Below the thickness-shear cut-off the roots lie about pi apart in the bending wavenumber and are bracketed by a scan; above
it two families interleave, and a Rayleigh-Ritz solution tells where to look.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import pi, sqrt

import numpy as np

from geometry.elements import FloatArray
from solvers.analytic.beams import End, check_ends
from solvers.analytic.root_finding import root_between
from solvers.analytic.section import Beam, check_beam
from solvers.errors import SolverError

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
    omegas = _scanned(beam, left, right, count)
    return omegas if len(omegas) == count else _beyond_cutoff(beam, left, right, count, omegas)


def _scanned(beam: Beam, left: str, right: str, count: int) -> list[float]:
    """Roots below the cut-off, at most `count`: sign changes over the bending wavenumber."""
    cutoff = 1.0 / sqrt(beam.flexibility * beam.rotation)
    roots_hz: list[float] = []
    start, width = LOWEST, STEP * 4
    while len(roots_hz) < count:
        wavenumbers = np.arange(start, start + width + STEP / 2, STEP)
        omegas = [omega for omega in (_omega_of(float(a), beam) for a in wavenumbers) if omega < cutoff]
        omegas += [cutoff * (1.0 - 1e-12)] if len(omegas) < len(wavenumbers) else []
        roots_hz += _sign_changes(omegas, beam, left, right)
        if len(omegas) < len(wavenumbers):
            break
        start += width
    return roots_hz[:count]


def _omega_of(wavenumber: float, beam: Beam) -> float:
    """Dimensionless frequency of the bending wave of this wavenumber times L."""
    flex, turn, square = beam.flexibility, beam.rotation, wavenumber**2
    p = (flex + turn) * square + 1.0
    return sqrt(2.0 * square**2 / (p + sqrt(p**2 - 4.0 * flex * turn * square**2)))


def _sign_changes(omegas: list[float], beam: Beam, left: str, right: str) -> list[float]:
    def determinant(omega: float) -> float:
        return characteristic(omega, beam, left, right)

    values = [determinant(omega) for omega in omegas]
    pairs = pairwise(zip(omegas, values, strict=True))
    return [
        root_between(determinant, low, high, 1e-13 * low)
        for (low, at_low), (high, at_high) in pairs
        if (at_low < 0.0) != (at_high < 0.0)
    ]


def _beyond_cutoff(beam: Beam, left: End, right: End, count: int, below: list[float]) -> list[float]:
    """The first `count` roots when some lie above the cut-off: Ritz estimates, refined where a root is alone."""
    from solvers.analytic.ritz_beams import ritz_omegas

    estimates = ritz_omegas(beam, left, right, count)
    refined = list(below)
    for estimate in estimates[len(below) :]:
        low, high = estimate * (1.0 - REFINE), estimate * (1.0 + REFINE)
        roots = _sign_changes([low, high], beam, left, right)
        refined.append(roots[0] if roots else float(estimate))
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
