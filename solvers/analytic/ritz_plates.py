"""Rayleigh-Ritz estimates of the zone's (0, N) mode, thin (Kirchhoff) and shear-flexible (Mindlin) plate.

Legendre products over one quadrant, ends x = +-L/2 free, sides y = +-W/2 pinned or clamped; frequencies from above.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from threadpoolctl import ThreadpoolController

from geometry.elements import FloatArray
from solvers.analytic.beams import free_free_mode
from solvers.analytic.plates import Strip
from solvers.errors import SolverError

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

    Energy D/2 integral of (w_xx + w_yy)^2 - 2 (1 - nu)(w_xx w_yy - w_xy^2). SolverError for N < 0 or N > 40 or an
    unknown side. Source: leissa1969.
    """
    x, y = _along(strip, nodal_lines), _across(strip, _power(sides))
    nu = strip.poisson
    xx, x0 = _pair(x, x.curve, x.curve), _pair(x, x.value, x.value)
    yy, y0 = _pair(y, y.curve, y.curve), _pair(y, y.value, y.value)
    mixed = np.kron(_pair(x, x.curve, x.value), _pair(y, y.value, y.curve))
    twist = np.kron(_pair(x, x.slope, x.slope), _pair(y, y.slope, y.slope))
    stiffness = np.kron(xx, y0) + np.kron(x0, yy) + nu * (mixed + mixed.T) + 2.0 * (1.0 - nu) * twist
    mass: FloatArray = np.asarray(np.kron(x0, y0), dtype=np.float64)
    values, vectors = _lowest(strip.rigidity_n_m * stiffness, strip.mass_kg_m2 * mass, nodal_lines)
    return _wanted(values, vectors, x, y, nodal_lines)


def mindlin_mode(strip: Strip, nodal_lines: int, sides: Sides) -> ZoneMode:
    """The mode (0, N) with shear (factor 5/6) and rotary inertia; errors as kirchhoff_mode. Source: mindlin1951.

    Pinned sides hold w and the rotation along the side, clamped ones every displacement.
    """
    w = _along(strip, nodal_lines), _across(strip, 1)
    a = _along(strip, nodal_lines, odd_shift=1), w[1]
    b = w[0], _across(strip, 1 if _power(sides) == 2 else 0, odd=True)
    nu, d = strip.poisson, strip.rigidity_n_m
    g = 5.0 / 6.0 * strip.young_pa / (2.0 * (1.0 + nu)) * strip.thickness_m

    def block(left: tuple[_Axis, _Axis], right: tuple[_Axis, _Axis], dl: str, dr: str) -> FloatArray:
        along = _pair(left[0], getattr(left[0], dl.split()[0]), getattr(right[0], dr.split()[0]))
        across = _pair(left[1], getattr(left[1], dl.split()[1]), getattr(right[1], dr.split()[1]))
        return np.asarray(np.kron(along, across))

    vv, sv, vs = "value value", "slope value", "value slope"
    shear_ww = block(w, w, sv, sv) + block(w, w, vs, vs)
    bend_aa = block(a, a, sv, sv) + (1.0 - nu) / 2.0 * block(a, a, vs, vs)
    bend_bb = block(b, b, vs, vs) + (1.0 - nu) / 2.0 * block(b, b, sv, sv)
    bend_ab = nu * block(a, b, sv, vs) + (1.0 - nu) / 2.0 * block(a, b, vs, sv)
    aw, bw = -g * block(a, w, vv, sv), -g * block(b, w, vv, vs)
    aa, bb, ab = d * bend_aa + g * block(a, a, vv, vv), d * bend_bb + g * block(b, b, vv, vv), d * bend_ab
    stiffness = np.block([[g * shear_ww, aw.T, bw.T], [aw, aa, ab], [bw, ab.T, bb]])
    rotary = strip.mass_kg_m2 * strip.thickness_m**2 / 12.0
    size = shear_ww.shape[0]
    mass = np.zeros_like(stiffness)
    mass[:size, :size] = strip.mass_kg_m2 * block(w, w, vv, vv)
    mass[size : size + aa.shape[0], size : size + aa.shape[0]] = rotary * block(a, a, vv, vv)
    mass[-bb.shape[0] :, -bb.shape[0] :] = rotary * block(b, b, vv, vv)
    values, vectors = _lowest(stiffness, mass, nodal_lines)
    return _wanted(values, vectors[:size], *w, nodal_lines)


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


def _wanted(values: FloatArray, vectors: FloatArray, x: _Axis, y: _Axis, nodal_lines: int) -> ZoneMode:
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
