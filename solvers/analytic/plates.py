"""Plates without a mesh: the zone by Kirchhoff and by Mindlin, exact waves of a free plate, and their number of modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice
from math import cos, cosh, floor, hypot, pi, sin, sinh, sqrt, tanh
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from threadpoolctl import ThreadpoolController

from geometry.elements import FloatArray
from geometry.layout import Pillar
from geometry.materials import Material, Stack
from solvers.analytic.beams import roots_along, zone_mode
from solvers.errors import SolverError

Sides = Literal["pinned", "clamped"]
ACROSS = 5  # even polynomials across the zone
MAX_LINES = 40  # beyond, the dense matrices would take seconds

THIN = 0.05  # k h / 2 below which the two terms of the flexural equation cancel too far for double precision
ROUNDS, TERMS = 30, 9  # to rounding below THIN
SOME = 0.5  # of a branch on a clamped plate: fewer are none
MAX_BRANCHES = 200  # across one side: beyond, the volume alone counts


@dataclass(frozen=True)
class Strip:
    """The bare zone, lengths in m: along x (free ends, of which `held` are pinned), across along y (held sides); its layers."""

    length_m: float
    width_m: float
    stack: Stack
    held: int = 0

    def __post_init__(self) -> None:
        sizes = (self.length_m, self.width_m, self.stack.thickness_m)
        if not all(np.isfinite(size) and size > 0.0 for size in sizes):
            raise SolverError(f"{self}: sizes must be above 0")

    def doubled(self, nodal_lines: int) -> tuple[Strip, int]:
        """The strip with free or pinned ends alone and the number of lines on it: one with a pinned and a free end is half of
        one twice as long with free ends, in a mode that is odd about its middle.
        """
        if self.held != 1:
            return self, nodal_lines
        return replace(self, length_m=2.0 * self.length_m, held=0), 2 * nodal_lines + 1

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


def thin_plate_hz(strip: Strip, along_per_m: float, across_per_m: float = 0.0) -> float:
    """Compute the frequency of a Kirchhoff plate's wave; k^2 sqrt(D/(rho h))/(2 pi) for an isotropic plate.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the plate.
    along_per_m, across_per_m : float
        Wavenumbers along x and y, in rad/m.

    Returns
    -------
    float
        In Hz.

    References
    ----------
    .. [1] leissa1969 (docs/references.bib)
    """
    return sqrt(strip.wave_n_m3(along_per_m**2, across_per_m**2) / strip.stack.mass_kg_m2) / (2.0 * pi)


def mindlin_wave_hz(strip: Strip, along_per_m: float, across_per_m: float = 0.0) -> float:
    """Compute the frequency of a Mindlin plate's bending wave, with a shear factor of 5/6.

    Lower root of r b w^4 - (1 + (r + b) k^2) w^2 + k^4 = 0 with w^2 in units of D/(rho h), r = h^2/12 (rotary inertia),
    b = D/(5/6 G h) (shear), D and G along the wave.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the plate.
    along_per_m, across_per_m : float
        Wavenumbers along x and y, in rad/m.

    Returns
    -------
    float
        In Hz.

    References
    ----------
    .. [1] mindlin1951 (docs/references.bib)
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
    """Compute the thesis' estimate (2.25), f = 1/(2 pi) sqrt(D/(rho h)) (k^2 + (pi/W)^2), with the free-free beam's k.

    k is 0 for N = 0 and 1. The beam function satisfies neither the plate equation nor a plate's free edge (see levy_hz).

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.

    Returns
    -------
    float
        In Hz.
    """
    kappa = zone_mode(nodal_lines, strip.held > 0, strip.held > 1).kappa
    return thin_plate_hz(strip, kappa / strip.length_m, strip.across_per_m)


def levy_wavenumber_per_m(strip: Strip, nodal_lines: int) -> float:
    """Solve Levy's equation for kappa of the exact Kirchhoff mode with N nodal lines, pinned sides and free ends.

    omega = kappa^2 sqrt(D/(rho h)) for an isotropic plate. w = X(x) sin(pi y/W); free edge X'' = nu q^2 X,
    X''' = (2 - nu) q^2 X', q = pi/W. Even N: a+^2 k sin(kL/2) + a-^2 s tanh(sL/2) cos(kL/2) = 0; odd N:
    a+^2 k cos(kL/2) tanh(sL/2) - a-^2 s sin(kL/2) = 0; k^2 = kappa^2 - h q^2, s^2 = kappa^2 + h q^2, a+- = kappa^2 +- t q^2.
    nu, h = 1 and t = 1 - nu are the `levy_ratios`; an orthotropic plate has others.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.

    Returns
    -------
    float
        kappa, in rad/m.

    Raises
    ------
    SolverError
        For a negative N, or if the mode is not found.

    References
    ----------
    .. [1] leissa1969 (docs/references.bib)
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


def levy_along_per_m2(strip: Strip, nodal_lines: int) -> float:
    """Compute the square k^2 of the Levy mode's wavenumber along x.

    Between two pinned ends k = (N + 1) pi/L.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.

    Returns
    -------
    float
        In rad^2/m^2; below 0 where the mode decays from the ends.
    """
    if strip.held == 2:
        return ((nodal_lines + 1) * pi / strip.length_m) ** 2
    strip, nodal_lines = strip.doubled(nodal_lines)
    return levy_wavenumber_per_m(strip, nodal_lines) ** 2 - strip.levy_ratios[1] * strip.across_per_m**2


def levy_hz(strip: Strip, nodal_lines: int) -> float:
    """Compute the frequency of the exact Kirchhoff mode (0, N) with pinned sides; see levy_along_per_m2.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.

    Returns
    -------
    float
        In Hz.
    """
    bent = strip.wave_n_m3(levy_along_per_m2(strip, nodal_lines), strip.across_per_m**2)
    return sqrt(bent / strip.stack.mass_kg_m2) / (2.0 * pi)


def kirchhoff_mode(strip: Strip, nodal_lines: int, sides: Sides) -> ZoneMode:
    """Compute the thin-plate mode (0, N) by Ritz.

    Energy 1/2 integral of D_11 w_xx^2 + D_22 w_yy^2 + 2 D_12 w_xx w_yy + 4 D_66 w_xy^2.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.
    sides : {"pinned", "clamped"}
        Support of the long sides.

    Returns
    -------
    ZoneMode
        Frequency in Hz and shape.

    Raises
    ------
    SolverError
        For N below 0 or above 40, or an unknown side.

    References
    ----------
    .. [1] leissa1969 (docs/references.bib)
    """
    strip, nodal_lines = strip.doubled(nodal_lines)
    x, y = _along(strip, nodal_lines, pinned=True), _across(strip, _power(sides))
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
    return _target(values, vectors, (x, y), nodal_lines, strip.held > 0)


def mindlin_mode(strip: Strip, nodal_lines: int, sides: Sides) -> ZoneMode:
    """Compute the mode (0, N) by Ritz with shear (factor 5/6) and rotary inertia.

    Pinned sides and ends hold w and the rotation along them, clamped ones every displacement.

    Parameters
    ----------
    strip : Strip
        Sizes and layers of the zone.
    nodal_lines : int
        N.
    sides : {"pinned", "clamped"}
        Support of the long sides.

    Returns
    -------
    ZoneMode
        Frequency in Hz and shape.

    Raises
    ------
    SolverError
        As `kirchhoff_mode`.

    References
    ----------
    .. [1] mindlin1951 (docs/references.bib)
    """
    strip, nodal_lines = strip.doubled(nodal_lines)
    w = _along(strip, nodal_lines, pinned=True), _across(strip, 1)
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
    return _target(values, vectors[:size], w, nodal_lines, strip.held > 0)


def lamb_hz(wavenumber_per_m: float, thickness_m: float, material: Material, symmetric: bool) -> float:
    """Compute the frequency of the lowest Lamb wave, S0 or A0.

    A0: 4 k^2 q^2 [sin(qb)/q] cos(pb) + (q^2 - k^2)^2 [sin(pb)/p] cos(qb) = 0 with p^2 = w^2/c_l^2 - k^2,
    q^2 = w^2/c_t^2 - k^2, b = h/2; S0 with sines and cosines exchanged.

    Parameters
    ----------
    wavenumber_per_m, thickness_m : float
        k in rad/m, and h.
    material : Material
        An isotropic law.
    symmetric : bool
        S0 instead of A0.

    Returns
    -------
    float
        In Hz.

    Raises
    ------
    SolverError
        Unless k and h are above 0.
    GeometryError
        For a law that is not isotropic.

    References
    ----------
    .. [1] lamb1917 (docs/references.bib)
    """
    if not (wavenumber_per_m > 0.0 and thickness_m > 0.0):
        raise SolverError(f"wavenumber {wavenumber_per_m} 1/m, thickness {thickness_m} m: both must be above 0")
    material.as_isotropic  # noqa: B018  refuses any other law
    if not symmetric and wavenumber_per_m * thickness_m / 2.0 < THIN:
        return _thin_a0_hz(wavenumber_per_m, thickness_m, material)
    slow, fast = material.shear_m_s, material.pressure_m_s
    b, k2 = thickness_m / 2.0, wavenumber_per_m**2

    def characteristic(speed: float) -> float:
        p2, q2 = k2 * ((speed / fast) ** 2 - 1.0), k2 * ((speed / slow) ** 2 - 1.0)
        if symmetric:
            return 4.0 * k2 * p2 * _s(p2, b) * _c(q2, b) + (q2 - k2) ** 2 * _c(p2, b) * _s(q2, b)
        return 4.0 * k2 * q2 * _s(q2, b) * _c(p2, b) + (q2 - k2) ** 2 * _s(p2, b) * _c(q2, b)

    speed = next(roots_along(characteristic, slow * np.linspace(0.02, 2.0, 2000), 1e-10), None)
    if speed is None:
        raise SolverError("no wave found between the speeds searched")
    return speed * wavenumber_per_m / (2.0 * pi)


def supported_plate_hz(m: int, n: int, edges_m: tuple[float, float], thickness_m: float, material: Material) -> float:
    """Compute the flexural mode (m, n) of a rectangle on hard supports (u_z = 0, tangential u = 0), exact in three dimensions.

    Parameters
    ----------
    m, n : int
        Half-waves along both edges.
    edges_m : tuple of float
        Lengths of both edges.
    thickness_m : float
        Thickness of the plate.
    material : Material
        An isotropic law.

    Returns
    -------
    float
        In Hz.
    """
    return lamb_hz(pi * hypot(m / edges_m[0], n / edges_m[1]), thickness_m, material, False)


def plate_modes(
    frequency_hz: float, length_m: float, width_m: float, thickness_m: float, material: Material, clamped_m: float = 0.0
) -> float:
    """Estimate the number of modes of a rectangular plate below a frequency: (A k^2 - R k)/(4 pi) + 1/4 per branch.

    Parameters
    ----------
    frequency_hz : float
        The frequency.
    length_m, width_m, thickness_m : float
        Sizes of the plate.
    material : Material
        Of the plate.
    clamped_m : float, optional
        Length R of the clamped part of its rim.

    Returns
    -------
    float
        Expected number.
    """
    area, waves = length_m * width_m, _branches(frequency_hz, thickness_m, material)
    if not clamped_m:
        return area * sum(k * k for k in waves) / (4.0 * pi)
    counts = [(area * k * k - clamped_m * k) / (4.0 * pi) + 0.25 for k in waves]
    return sum(count for count in counts if count >= SOME)


def pillar_modes(frequency_hz: float, pillar: Pillar) -> float:
    """Estimate the number of modes below a frequency of a pillar clamped at its foot.

    Every branch of its section has h (n - 1/2) half-waves along the pillar. Several sections count as a pillar of the highest
    one's section and stiffness, the total height and the total mass.

    Parameters
    ----------
    frequency_hz : float
        The frequency.
    pillar : Pillar
        Sizes and material.

    Returns
    -------
    float
        Expected number.
    """
    highest = pillar.parts[pillar.highest]
    height, material = pillar.top_m, highest.material
    side = sqrt(highest.form.section.area_m2)
    if pillar.upper:
        material = replace(material, density_kg_m3=pillar.mass_kg / (side**2 * height))
    shear, longitudinal, bending = _waves(frequency_hz, side, material)
    if shear * side / pi > MAX_BRANCHES:
        return height * side**2 * (longitudinal**3 + 2.0 * shear**3) / (6.0 * pi**2)
    across = (np.arange(floor(shear * side / pi) + 1) * pi / side) ** 2
    section = across[:, None] + across
    lowest = 2 * _half_waves(bending, height) + _half_waves(shear, height) + _half_waves(longitudinal, height)
    section[0, 0] = np.inf
    return lowest + sum(
        many * float(np.floor(np.sqrt(np.maximum(k * k - section, 0.0)) * height / pi + 0.5).sum())
        for k, many in ((shear, 2), (longitudinal, 1))
    )


def highest_hz(count: float, modes_below: Callable[[float], float], start_hz: float = 1.0) -> float:
    """Find by bisection the frequency below which a body has a number of modes.

    Parameters
    ----------
    count : float
        Number of modes.
    modes_below : callable
        Expected number of modes below a frequency in Hz.
    start_hz : float, optional
        First trial.

    Returns
    -------
    float
        In Hz.
    """
    high = start_hz
    while modes_below(high) < count:
        high *= 2.0
        if high > 1e15:
            return high
    low = high / 2.0
    for _ in range(40):
        middle = (low + high) / 2.0
        low, high = (middle, high) if modes_below(middle) < count else (low, middle)
    return high


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
    """Thread limit, made once: looking up the loaded thread pools takes as long as one of the solves."""
    return ThreadpoolController()


def _power(sides: str) -> int:
    if sides not in ("pinned", "clamped"):
        raise SolverError(f"sides {sides!r}: must be pinned or clamped")
    return 1 if sides == "pinned" else 2


def _along(strip: Strip, nodal_lines: int, odd_shift: int = 0, pinned: bool = False) -> _Axis:
    """Legendre polynomials of the mode's parity along x, enough for N nodes; odd_shift = 1 for the rotation. `pinned`: what
    pinned ends hold is 0 there.
    """
    if not 0 <= nodal_lines <= MAX_LINES:
        raise SolverError(f"nodal lines = {nodal_lines}: must be from 0 to {MAX_LINES} for a Ritz estimate")
    parity = (nodal_lines + odd_shift) % 2
    power = 1 if pinned and strip.held else 0
    return _axis(strip.length_m, parity, int(0.8 * nodal_lines) + 9, power)  # N half-waves need a degree of pi/2 N


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
    """Points and weights of the Gauss-Legendre rule; a plate needs the same two rules a dozen times."""
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


def _target(
    values: FloatArray, vectors: FloatArray, axes: tuple[_Axis, _Axis], nodal_lines: int, pinned: bool
) -> ZoneMode:
    """The Ritz mode most like sin(pi y/W) times the shape with N nodes between free or pinned ends."""
    x, y = axes
    points_x, _ = _gauss(len(x.weights))
    points_y, _ = _gauss(len(y.weights))
    shape_x = zone_mode(nodal_lines, pinned, pinned).shape((points_x + 1.0) / 2.0)
    shape_y = np.cos(pi * points_y / 2.0)
    target = np.kron(x.value.T @ (x.weights * shape_x), y.value.T @ (y.weights * shape_y))
    own = float(x.weights @ shape_x**2) * float(y.weights @ shape_y**2)
    mass = np.kron(_pair(x, x.value, x.value), _pair(y, y.value, y.value))
    norms = np.einsum("ij,ij->j", vectors, mass @ vectors)
    mac = (target @ vectors) ** 2 / (own * norms)
    best = int(np.argmax(mac))
    return ZoneMode(sqrt(abs(float(values[best]))) / (2.0 * pi), float(mac[best]))


def _c(square: float, b: float) -> float:
    return cos(sqrt(square) * b) if square >= 0.0 else cosh(sqrt(-square) * b)


def _s(square: float, b: float) -> float:
    """sin(p b) / p, entire in p^2."""
    if abs(square) * b * b < 1e-12:
        return b
    return sin(sqrt(square) * b) / sqrt(square) if square > 0.0 else sinh(sqrt(-square) * b) / sqrt(-square)


def _thin_a0_hz(wavenumber_per_m: float, thickness_m: float, material: Material) -> float:
    """A0 of a thin plate, where the two terms of its equation almost cancel: their difference, by fixed point.

    Over b, with K = (kb)^2, W = (w b/c_t)^2, X = (pb)^2, Y = (qb)^2 and m = 1 - (c_t/c_l)^2 the equation is
    W sin(pb)/(pb) cos(qb) = 4 K (K - W) m h, h = [sin(qb)/(qb) cos(pb) - sin(pb)/(pb) cos(qb)]/(Y - X), 1/3 for thin plates.
    """
    k2, m = (wavenumber_per_m * thickness_m / 2.0) ** 2, 1.0 - (material.shear_m_s / material.pressure_m_s) ** 2
    w = 4.0 * k2**2 * m / 3.0
    for _ in range(ROUNDS):
        x, y = w * (1.0 - m) - k2, w - k2
        w = 4.0 * k2 * (k2 - w) * m * _cancelled(x, y) / (_s(x, 1.0) * _c(y, 1.0))
    return sqrt(w) * material.shear_m_s / (pi * thickness_m)


def _cancelled(x: float, y: float) -> float:
    """h of x and y: sum of -2 (-1)^n P_n/(2 n + 1)!, P_1 = 1, P_2 = 2 (x + y), P_n+1 = P_2 P_n - (x - y)^2 P_n-1."""
    before, last, total, factor = 0.0, 1.0, 0.0, 2.0
    for n in range(1, TERMS):
        factor /= -2.0 * n * (2.0 * n + 1.0)
        total -= factor * last
        before, last = last, 2.0 * (x + y) * last - (x - y) ** 2 * before
    return total


def _half_waves(wavenumber: float, height_m: float) -> int:
    return floor(wavenumber * height_m / pi + 0.5)


def _waves(frequency_hz: float, thickness_m: float, material: Material) -> tuple[float, float, float]:
    """Wavenumbers of shear, longitudinal and bending waves, rad/m; a bending wave is no faster than a shear wave."""
    omega = 2.0 * pi * frequency_hz
    shear, own = omega / material.shear_m_s, material.average
    longitudinal = omega / material.pressure_m_s
    inertia = 12.0 * material.density_kg_m3 * (1.0 - own.poisson**2) / (own.young_pa * thickness_m**2)
    return shear, longitudinal, max((inertia * omega**2) ** 0.25, shear)


def _branches(frequency_hz: float, thickness_m: float, material: Material) -> list[float]:
    """Real wavenumbers of a plate's branches, rad/m."""
    shear, longitudinal, bending = _waves(frequency_hz, thickness_m, material)
    plane = shear * sqrt((1.0 - material.average.poisson) / 2.0)  # the plate's own longitudinal wave
    branches = [bending, shear, plane]
    for wave, many in ((shear, 2), (longitudinal, 1)):
        branches += many * _higher(wave, thickness_m)
    return branches


def _higher(wave: float, thickness_m: float) -> list[float]:
    last = floor(wave * thickness_m / pi)
    if last > MAX_BRANCHES:  # as many as before of the same sum of squares: the integral
        number = np.linspace(0.0, 1.0, MAX_BRANCHES + 1)[:-1] + 0.5 / MAX_BRANCHES
        return list(wave * np.sqrt((1.0 - number**2) * last / MAX_BRANCHES))
    number = np.arange(1.0, last + 1.0)
    squares: FloatArray = wave**2 - (number * pi / thickness_m) ** 2
    return list(np.sqrt(np.maximum(squares, 0.0)))
