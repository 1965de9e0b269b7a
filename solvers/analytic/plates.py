"""The zone as a plate, sides y = +-W/2 held and ends x = +-L/2 free: thin (Kirchhoff) and shear-flexible (Mindlin)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from math import cos, pi, sin, sqrt, tanh
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from threadpoolctl import ThreadpoolController

from geometry.elements import FloatArray
from geometry.stack import Stack
from solvers.analytic.beams import free_free_mode, roots_along
from solvers.errors import SolverError

# -- formulas and exact solutions --------------------------------------------------------------------------------------
# The zone as a thin plate: sides y = 0 and y = W clamped, ends x = +-L/2 free. The thesis' formula and exact solutions.


@dataclass(frozen=True)
class Strip:
    """The bare zone, lengths in m: along x (free ends), across along y (held sides); its layers."""

    length_m: float
    width_m: float
    stack: Stack

    def __post_init__(self) -> None:
        sizes = (self.length_m, self.width_m, self.stack.thickness_m)
        if not all(np.isfinite(size) and size > 0.0 for size in sizes):
            raise SolverError(f"{self}: sizes must be above 0")

    @property
    def across_per_m(self) -> float:
        """pi/W, wavenumber across of the lowest shape between pinned sides, rad/m."""
        return pi / self.width_m

    def wave_n_m3(self, along: float, across: float) -> float:
        """D_11 a^2 + 2 (D_12 + 2 D_66) a b + D_22 b^2 of squared wavenumbers a along x and b along y, rad2/m2: what bends."""
        d = self.stack.bending_n_m
        return float(d[0, 0] * along**2 + 2.0 * (d[0, 1] + 2.0 * d[2, 2]) * along * across + d[1, 1] * across**2)

    @cached_property
    def levy_ratios(self) -> tuple[float, float, float]:
        """D_12, D_12 + 2 D_66 and 2 D_66 over D_11: nu, 1 and 1 - nu of isotropic ones."""
        d = self.stack.bending_n_m
        poisson, twist = (float(part / d[0, 0]) for part in d[[0, 2], [1, 2]])
        return poisson, poisson + 2.0 * twist, 2.0 * twist


def thin_plate_hz(strip: Strip, along_per_m: float, across_per_m: float = 0.0) -> float:
    """Frequency of a Kirchhoff plate's wave from its wavenumbers along x and y, Hz: k^2 sqrt(D/(rho h)) of isotropic ones.

    Source: leissa1969.
    """
    return sqrt(strip.wave_n_m3(along_per_m**2, across_per_m**2) / strip.stack.mass_kg_m2) / (2.0 * pi)


def mindlin_wave_hz(strip: Strip, along_per_m: float, across_per_m: float = 0.0) -> float:
    """Frequency of a Mindlin plate's bending wave from its wavenumbers along x and y, Hz, shear factor 5/6.

    Lower root of r b w^4 - (1 + (r + b) k^2) w^2 + k^4 = 0 with w^2 in units of D/(rho h), r = h^2/12 (rotary inertia),
    b = D/(5/6 G h) (shear), D and G along the wave. Source: mindlin1951.
    """
    squares = along_per_m**2, across_per_m**2
    k2 = sum(squares)
    rigidity = strip.wave_n_m3(*squares) / k2**2
    shear = sum(part * square for part, square in zip(strip.stack.shear_n_m, squares, strict=True)) / k2
    r, b = strip.stack.rotary_kg / strip.stack.mass_kg_m2, rigidity / shear
    p = 1.0 + (r + b) * k2
    square = 2.0 * k2**2 / (p + sqrt(p**2 - 4.0 * r * b * k2**2))
    return sqrt(square * rigidity / strip.stack.mass_kg_m2) / (2.0 * pi)


def beam_function_hz(strip: Strip, nodal_lines: int) -> float:
    """The thesis' (2.25): f = 1/(2 pi) sqrt(D/(rho h)) (k^2 + (pi/W)^2), Hz, with the free-free beam's k: 0 for N = 0, 1.

    An estimate: the beam function meets neither the plate equation nor a plate's free edge (see levy_hz).
    """
    return thin_plate_hz(strip, free_free_mode(nodal_lines).kappa / strip.length_m, strip.across_per_m)


def levy_wavenumber_per_m(strip: Strip, nodal_lines: int) -> float:
    """kappa of the exact Kirchhoff mode with N nodal lines, pinned sides and free ends; omega = kappa^2 sqrt(D/rho h) of an
    isotropic plate.

    w = X(x) sin(pi y/W); free edge X'' = nu q^2 X, X''' = (2 - nu) q^2 X', q = pi/W. Even N:
    a+^2 k sin(kL/2) + a-^2 s tanh(sL/2) cos(kL/2) = 0; odd N: a+^2 k cos(kL/2) tanh(sL/2) - a-^2 s sin(kL/2) = 0;
    k^2 = kappa^2 - h q^2, s^2 = kappa^2 + h q^2, a+- = kappa^2 +- t q^2, with nu, h = 1 and t = 1 - nu the `levy_ratios`:
    an orthotropic plate has others. SolverError for N < 0. Source: leissa1969.
    """
    if nodal_lines < 0:
        raise SolverError(f"nodal lines = {nodal_lines}: must be 0 or more")
    q, (nu, mixed, _) = strip.across_per_m, strip.levy_ratios
    low = q * 0.5 * (mixed**2 - nu**2) ** 0.25  # the narrow-strip limit is twice this
    step, even = 0.125 * pi / strip.length_m, nodal_lines % 2 == 0
    grid = [low, *(sqrt(mixed * q**2 + (i * step) ** 2) for i in range(8 * (nodal_lines + 3)))]
    found = roots_along(lambda kappa: _free_edges(kappa, strip, even), grid, 1e-14 * q)
    kappa = next(islice(found, nodal_lines // 2, None), None)
    if kappa is None:
        raise SolverError(f"Levy's equation: the mode with {nodal_lines} nodal lines was not found for {strip}")
    return kappa


def _free_edges(kappa: float, strip: Strip, even: bool) -> float:
    """The free-edge equation over kappa^4 (odd: over k too); below the cut-off k = i p, over cosh(pL/2) as well."""
    q, half, (_, mixed, twist) = strip.across_per_m, strip.length_m / 2.0, strip.levy_ratios
    plus, minus = (1.0 + twist * (q / kappa) ** 2) ** 2, (1.0 - twist * (q / kappa) ** 2) ** 2
    s, k2 = sqrt(kappa**2 + mixed * q**2), kappa**2 - mixed * q**2
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


def levy_along_per_m2(strip: Strip, nodal_lines: int) -> float:
    """Square k^2 of the same mode's wavenumber along x, rad2/m2; below 0 where it decays from the ends."""
    return levy_wavenumber_per_m(strip, nodal_lines) ** 2 - strip.levy_ratios[1] * strip.across_per_m**2


def levy_hz(strip: Strip, nodal_lines: int) -> float:
    """Frequency of the exact Kirchhoff mode (0, N), pinned sides, free ends, Hz; see levy_wavenumber_per_m."""
    bent = strip.wave_n_m3(levy_along_per_m2(strip, nodal_lines), strip.across_per_m**2)
    return sqrt(bent / strip.stack.mass_kg_m2) / (2.0 * pi)


# -- Rayleigh-Ritz -----------------------------------------------------------------------------------------------------
# Rayleigh-Ritz estimates of the zone's (0, N) mode, thin (Kirchhoff) and shear-flexible (Mindlin) plate.
# Legendre products over one quadrant, ends x = +-L/2 free, sides y = +-W/2 pinned or clamped; frequencies from above.

Sides = Literal["pinned", "clamped"]
ACROSS = 5  # even polynomials across the zone
MAX_LINES = 40  # beyond, the dense matrices would take seconds


@dataclass(frozen=True)
class ZoneMode:
    """The mode found: frequency in Hz and mac, its modal overlap to sin(pi y/W) times the free-free beam shape (0 to 1)."""

    frequency_hz: float
    mac: float


@dataclass(frozen=True)
class _Axis:
    """Values and slopes of the one-dimensional functions at the quadrature points of one axis."""

    weights: FloatArray
    value: FloatArray
    slope: FloatArray
    curve: FloatArray


def kirchhoff_mode(strip: Strip, nodal_lines: int, sides: Sides) -> ZoneMode:
    """The thin-plate mode (0, N).

    Energy 1/2 integral of D_11 w_xx^2 + D_22 w_yy^2 + 2 D_12 w_xx w_yy + 4 D_66 w_xy^2. SolverError for N < 0 or N > 40 or an
    unknown side. Source: leissa1969.
    """
    x, y = _along(strip, nodal_lines), _across(strip, _power(sides))
    d = strip.stack.bending_n_m
    xx, x0 = _pair(x, x.curve, x.curve), _pair(x, x.value, x.value)
    yy, y0 = _pair(y, y.curve, y.curve), _pair(y, y.value, y.value)
    mixed = np.kron(_pair(x, x.curve, x.value), _pair(y, y.value, y.curve))
    twist = np.kron(_pair(x, x.slope, x.slope), _pair(y, y.slope, y.slope))
    stiffness = (
        d[0, 0] * np.kron(xx, y0) + d[1, 1] * np.kron(x0, yy) + d[0, 1] * (mixed + mixed.T) + 4.0 * d[2, 2] * twist
    )
    mass: FloatArray = np.asarray(np.kron(x0, y0), dtype=np.float64)
    values, vectors = _lowest(stiffness, strip.stack.mass_kg_m2 * mass, nodal_lines)
    return _target(values, vectors, x, y, nodal_lines)


def mindlin_mode(strip: Strip, nodal_lines: int, sides: Sides) -> ZoneMode:
    """The mode (0, N) with shear (factor 5/6) and rotary inertia; errors as kirchhoff_mode. Source: mindlin1951.

    Pinned sides hold w and the rotation along the side, clamped ones every displacement.
    """
    w = _along(strip, nodal_lines), _across(strip, 1)
    a = _along(strip, nodal_lines, odd_shift=1), w[1]
    b = w[0], _across(strip, 1 if _power(sides) == 2 else 0, odd=True)
    d, (gx, gy) = strip.stack.bending_n_m, strip.stack.shear_n_m

    def block(left: tuple[_Axis, _Axis], right: tuple[_Axis, _Axis], dl: str, dr: str) -> FloatArray:
        along = _pair(left[0], getattr(left[0], dl.split()[0]), getattr(right[0], dr.split()[0]))
        across = _pair(left[1], getattr(left[1], dl.split()[1]), getattr(right[1], dr.split()[1]))
        return np.asarray(np.kron(along, across))

    vv, sv, vs = "value value", "slope value", "value slope"
    shear_ww = gx * block(w, w, sv, sv) + gy * block(w, w, vs, vs)
    bend_aa = d[0, 0] * block(a, a, sv, sv) + d[2, 2] * block(a, a, vs, vs)
    bend_bb = d[1, 1] * block(b, b, vs, vs) + d[2, 2] * block(b, b, sv, sv)
    ab = d[0, 1] * block(a, b, sv, vs) + d[2, 2] * block(a, b, vs, sv)
    aw, bw = -gx * block(a, w, vv, sv), -gy * block(b, w, vv, vs)
    aa, bb = bend_aa + gx * block(a, a, vv, vv), bend_bb + gy * block(b, b, vv, vv)
    stiffness = np.block([[shear_ww, aw.T, bw.T], [aw, aa, ab], [bw, ab.T, bb]])
    rotary = strip.stack.rotary_kg
    size = shear_ww.shape[0]
    mass = np.zeros_like(stiffness)
    mass[:size, :size] = strip.stack.mass_kg_m2 * block(w, w, vv, vv)
    mass[size : size + aa.shape[0], size : size + aa.shape[0]] = rotary * block(a, a, vv, vv)
    mass[-bb.shape[0] :, -bb.shape[0] :] = rotary * block(b, b, vv, vv)
    values, vectors = _lowest(stiffness, mass, nodal_lines)
    return _target(values, vectors[:size], *w, nodal_lines)


def _lowest(stiffness: FloatArray, mass: FloatArray, nodal_lines: int) -> tuple[FloatArray, FloatArray]:
    """Enough modes of one parity class to hold (0, N); one thread, since two only wait for each other at this size."""
    last = min(len(stiffness), ACROSS * (nodal_lines // 2 + 1) + 3) - 1
    with _threads().limit(limits=1):  # by numpy alone: importing scipy.linalg takes several times as long as the solve
        lower = np.linalg.cholesky(mass)
        standard = np.linalg.solve(lower, np.linalg.solve(lower, stiffness).T)
        values, vectors = np.linalg.eigh((standard + standard.T) / 2.0)
        return values[: last + 1], np.linalg.solve(lower.T, vectors[:, : last + 1])


@lru_cache(maxsize=1)
def _threads() -> ThreadpoolController:
    """Found once: looking up the loaded thread pools takes as long as one of the solves."""
    return ThreadpoolController()


def _power(sides: str) -> int:
    if sides not in ("pinned", "clamped"):
        raise SolverError(f"sides {sides!r}: must be pinned or clamped")
    return 1 if sides == "pinned" else 2


def _along(strip: Strip, nodal_lines: int, odd_shift: int = 0) -> _Axis:
    """Legendre polynomials of the mode's parity along x, enough for N nodes; odd_shift = 1 for the rotation."""
    if not 0 <= nodal_lines <= MAX_LINES:
        raise SolverError(f"nodal lines = {nodal_lines}: must be from 0 to {MAX_LINES} for a Ritz estimate")
    parity = (nodal_lines + odd_shift) % 2
    return _axis(strip.length_m, parity, int(0.8 * nodal_lines) + 9, 0)  # N half-waves need a degree of pi/2 N


def _across(strip: Strip, power: int, odd: bool = False) -> _Axis:
    return _axis(strip.width_m, int(odd), ACROSS, power)


def _axis(size_m: float, parity: int, count: int, power: int) -> _Axis:
    """(1 - eta^2)^power P_n(eta), n of one parity, with slopes and curves over metres, on a full Gauss rule."""
    points, weights = _gauss(2 * count + 10)
    orders = np.arange(parity, 2 * count + parity, 2)
    series = np.eye(2 * count + 2)[:, orders]
    for _ in range(power):
        series = _times_bubble(series)
    scale = 2.0 / size_m
    columns = [np.float64(scale**n) * legendre.legval(points, legendre.legder(series, n)).T for n in range(3)]
    return _Axis(weights / scale, *(np.asarray(column, dtype=np.float64) for column in columns))


@lru_cache(maxsize=32)
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights of the Gauss-Legendre rule; a plate asks for the same two rules a dozen times."""
    points, weights = legendre.leggauss(count)
    return points, weights


def _times_bubble(series: FloatArray) -> FloatArray:
    """Columns of Legendre coefficients times 1 - eta^2, from eta P_n = ((n + 1) P_n+1 + n P_n-1)/(2n + 1)."""
    n = np.arange(len(series) + 2)
    shift = np.diag((n[:-1] + 1.0) / (2.0 * n[:-1] + 1.0), -1) + np.diag(n[1:] / (2.0 * n[1:] + 1.0), 1)
    padded = np.vstack([series, np.zeros((2, series.shape[1]))])
    return np.asarray(padded - shift @ (shift @ padded))


def _pair(axis: _Axis, left: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(left.T @ (axis.weights[:, None] * right))


def _target(values: FloatArray, vectors: FloatArray, x: _Axis, y: _Axis, nodal_lines: int) -> ZoneMode:
    """The Ritz mode most like sin(pi y/W) times the free-free shape with N nodes."""
    points_x, _ = _gauss(len(x.weights))
    points_y, _ = _gauss(len(y.weights))
    shape_x = free_free_mode(nodal_lines).shape((points_x + 1.0) / 2.0)
    shape_y = np.cos(pi * points_y / 2.0)
    target = np.kron(x.value.T @ (x.weights * shape_x), y.value.T @ (y.weights * shape_y))
    own = float(x.weights @ shape_x**2) * float(y.weights @ shape_y**2)
    mass = np.kron(_pair(x, x.value, x.value), _pair(y, y.value, y.value))
    norms = np.einsum("ij,ij->j", vectors, mass @ vectors)
    mac = (target @ vectors) ** 2 / (own * norms)
    best = int(np.argmax(mac))
    return ZoneMode(sqrt(abs(float(values[best]))) / (2.0 * pi), float(mac[best]))
