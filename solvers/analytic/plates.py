"""The zone as a thin plate: sides y = 0 and y = W clamped, ends x = +-L/2 free. The thesis' formula and exact solutions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi, sin, sqrt, tanh

import numpy as np

from solvers.analytic.beams import free_free_mode
from solvers.analytic.root_finding import root_between
from solvers.errors import SolverError


@dataclass(frozen=True)
class Strip:
    """The bare zone, SI: length along x (free ends), width along y (clamped sides), thickness, elastic constants."""

    length_m: float
    width_m: float
    thickness_m: float
    young_pa: float
    density_kg_m3: float
    poisson: float

    def __post_init__(self) -> None:
        sizes = (self.length_m, self.width_m, self.thickness_m, self.young_pa, self.density_kg_m3)
        if not all(np.isfinite(size) and size > 0.0 for size in sizes) or not -1.0 < self.poisson < 0.5:
            raise SolverError(f"{self}: sizes and constants must be above 0, poisson between -1 and 0.5")

    @property
    def rigidity_n_m(self) -> float:
        """D = E h^3 / (12 (1 - nu^2)), N m."""
        return self.young_pa * self.thickness_m**3 / (12.0 * (1.0 - self.poisson**2))

    @property
    def mass_kg_m2(self) -> float:
        """rho h, kg/m2."""
        return self.density_kg_m3 * self.thickness_m

    @property
    def across_per_m(self) -> float:
        """pi/W, wavenumber across of the lowest shape between pinned sides, rad/m."""
        return pi / self.width_m


def thin_plate_hz(strip: Strip, wavenumber_per_m: float) -> float:
    """f = k^2/(2 pi) sqrt(D/(rho h)), Hz, of a Kirchhoff plate wave of this wavenumber. Source: leissa1969."""
    return wavenumber_per_m**2 / (2.0 * pi) * sqrt(strip.rigidity_n_m / strip.mass_kg_m2)


def mindlin_wave_hz(strip: Strip, wavenumber_per_m: float) -> float:
    """Frequency of a Mindlin plate's bending wave, Hz, shear factor 5/6.

    Lower root of r b w^4 - (1 + (r + b) k^2) w^2 + k^4 = 0 with w^2 in units of D/(rho h), r = h^2/12 (rotary inertia),
    b = D/(5/6 G h) (shear). Source: mindlin1951.
    """
    shear = 5.0 / 6.0 * strip.young_pa / (2.0 * (1.0 + strip.poisson)) * strip.thickness_m
    r, b, k2 = strip.thickness_m**2 / 12.0, strip.rigidity_n_m / shear, wavenumber_per_m**2
    p = 1.0 + (r + b) * k2
    square = 2.0 * k2**2 / (p + sqrt(p**2 - 4.0 * r * b * k2**2))
    return sqrt(square * strip.rigidity_n_m / strip.mass_kg_m2) / (2.0 * pi)


def beam_wavenumber_per_m(strip: Strip, nodal_lines: int) -> float:
    """k of the free-free beam shape with N nodes, cosh(kL) cos(kL) = 1, near (N - 1/2) pi/L; 0 for N = 0, 1. rad/m."""
    return free_free_mode(nodal_lines).kappa / strip.length_m


def beam_function_hz(strip: Strip, nodal_lines: int) -> float:
    """The thesis' (2.25): f = 1/(2 pi) sqrt(D/(rho h)) (k^2 + (pi/W)^2), Hz, with the free-free beam's k.

    An estimate: the beam function meets neither the plate equation nor a plate's free edge (see levy_hz).
    """
    return thin_plate_hz(strip, sqrt(beam_wavenumber_per_m(strip, nodal_lines) ** 2 + strip.across_per_m**2))


def levy_wavenumber_per_m(strip: Strip, nodal_lines: int) -> float:
    """kappa of the exact Kirchhoff mode with N nodal lines, pinned sides and free ends; omega = kappa^2 sqrt(D/rho h).

    w = X(x) sin(pi y/W); free edge X'' = nu q^2 X, X''' = (2 - nu) q^2 X', q = pi/W. Even N:
    a+^2 k sin(kL/2) + a-^2 s tanh(sL/2) cos(kL/2) = 0; odd N: a+^2 k cos(kL/2) tanh(sL/2) - a-^2 s sin(kL/2) = 0;
    k^2 = kappa^2 - q^2, s^2 = kappa^2 + q^2, a+- = kappa^2 +- (1 - nu) q^2. SolverError for N < 0. Source: leissa1969.
    """
    if nodal_lines < 0:
        raise SolverError(f"nodal lines = {nodal_lines}: must be 0 or more")
    q = strip.across_per_m
    low = q * 0.5 * (1.0 - strip.poisson**2) ** 0.25  # the narrow-strip limit is twice this
    sign_changes, step = 0, 0.125 * pi / strip.length_m
    even = nodal_lines % 2 == 0

    def edges(kappa: float) -> float:
        return _free_edges(kappa, strip, even)

    grid = [low, *(sqrt(q**2 + (i * step) ** 2) for i in range(8 * (nodal_lines + 3)))]
    for a, b in pairwise(grid):
        if (edges(a) < 0.0) != (edges(b) < 0.0):
            sign_changes += 1
            if sign_changes == nodal_lines // 2 + 1:
                return root_between(edges, a, b, 1e-14 * b)
    raise SolverError(f"Levy's equation: the mode with {nodal_lines} nodal lines was not found for {strip}")


def _free_edges(kappa: float, strip: Strip, even: bool) -> float:
    """The free-edge equation over kappa^4 (odd: over k too); below the cut-off k = i p, over cosh(pL/2) as well."""
    q, half, nu = strip.across_per_m, strip.length_m / 2.0, strip.poisson
    plus, minus = (1.0 + (1.0 - nu) * (q / kappa) ** 2) ** 2, (1.0 - (1.0 - nu) * (q / kappa) ** 2) ** 2
    s, k2 = sqrt(kappa**2 + q**2), kappa**2 - q**2
    k, rise = sqrt(abs(k2)), tanh(s * half)
    if k2 >= 0.0:
        over = sin(k * half) / k if k > 0.0 else half
        value = (
            plus * k2 * over + minus * s * rise * cos(k * half)
            if even
            else plus * cos(k * half) * rise - minus * s * over
        )
    else:
        over = tanh(k * half) / k
        value = plus * k2 * over + minus * s * rise if even else plus * rise - minus * s * over
    return value


def levy_hz(strip: Strip, nodal_lines: int) -> float:
    """Frequency of the exact Kirchhoff mode (0, N), pinned sides, free ends, Hz; see levy_wavenumber_per_m."""
    return thin_plate_hz(strip, levy_wavenumber_per_m(strip, nodal_lines))
