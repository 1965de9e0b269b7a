"""Stability of velocity feedback on a free-free beam: poles, characteristic loci, margins of delay and of gain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, permutations
from math import inf, pi

import numpy as np
from scipy.optimize import brentq

from geometry.elements import ComplexArray, FloatArray
from solvers.active_beam.feedback import Layout
from solvers.active_beam.free_beam import FreeBeam
from solvers.errors import SolverError

Filter = Callable[[FloatArray], ComplexArray]
HIGHEST_HZ = 1e12
MODES = 40  # of the pole calculation: 1e-3 of the whole beam's poles


def closed_loop_poles(beam: FreeBeam, layout: Layout, damper_n_s_m: float, modes: int = MODES) -> ComplexArray:
    """Poles of the first `modes` modes under f = -c C w', 1/s, shape (2 modes,), without delay.

    q'' + (theta Omega^2 + c P' B C P/m) q' + Omega^2 q = 0 with P the shapes at the points, B spread, C pick, m = rho A L.
    """
    shapes, square = beam.shapes(np.array(layout.points_m), modes), beam.natural_rad_s(modes) ** 2
    feedback = shapes.T @ np.array(layout.spread) @ np.array(layout.pick) @ shapes
    damping = np.diag(beam.viscosity_s * square) + damper_n_s_m / (beam.mass_kg_m * beam.length_m) * feedback
    unit = float(np.sqrt(square[-1])) or 1.0  # one size for displacement and velocity
    state = np.block([[np.zeros((modes, modes)), np.eye(modes)], [-np.diag(square) / unit**2, -damping / unit]])
    return np.asarray(np.linalg.eigvals(state) * unit)


def growth_per_s(beam: FreeBeam, layout: Layout, damper_n_s_m: float, modes: int = MODES) -> tuple[float, float]:
    """Largest real part of the poles other than rigid drift, 1/s, and that pole's frequency, Hz; above 0 is unstable."""
    poles = closed_loop_poles(beam, layout, damper_n_s_m, modes)
    moving = poles[np.abs(poles) > 1e-3 * beam.natural_rad_s(3)[2]]
    worst = moving[np.argmax(moving.real)]
    return float(worst.real), float(abs(worst.imag) / (2.0 * pi))


@dataclass(frozen=True)
class Loci:
    """Eigenvalues of the return ratio per unit damper over n frequencies, (n, loops), followed from one to the next.

    omega_rad_s (n,) from the carrier's neighbourhood to the upper end. Gain and delay are common to all loops, so that
    these eigenvalues' distance from -1 gives their margins exactly.
    """

    omega_rad_s: FloatArray
    values: ComplexArray


def characteristic_loci(beam: FreeBeam, layout: Layout, high_hz: float, low_hz: float = 1.0) -> Loci:
    """Eigenvalues of j omega C G(j omega) B on a grid that resolves every resonance from low_hz to high_hz."""
    omega = _grid(beam, 2.0 * pi * low_hz, 2.0 * pi * high_hz)
    spread, pick, points = np.array(layout.spread), np.array(layout.pick), np.array(layout.points_m)
    loci = 1j * omega[:, None, None] * (pick @ beam.receptance(points, points, 1j * omega) @ spread)
    values = np.linalg.eigvals(loci)
    orders = [list(order) for order in permutations(range(values.shape[1]))]
    for i in range(1, len(values)):
        candidates = values[i][np.array(orders)]
        values[i] = candidates[np.argmin(np.sum(np.abs(candidates - values[i - 1]), axis=1))]
    return Loci(omega, values)


def highest_hz(beam: FreeBeam, layout: Layout, damper_n_s_m: float) -> float:
    """A frequency, Hz, above which no loop of this damper has a gain of 1: |lambda| falls as omega^-1/2, and faster with
    losses.
    """
    spread, pick, points = np.array(layout.spread), np.array(layout.pick), np.array(layout.points_m)
    high = 1e5
    while high < HIGHEST_HZ:
        s = 2j * pi * high
        if damper_n_s_m * np.abs(np.linalg.eigvals(s * pick @ beam.receptance(points, points, s) @ spread)).max() < 0.5:
            break
        high *= 2.0
    return high


def _grid(beam: FreeBeam, low: float, high: float) -> FloatArray:
    """Logarithmic, with clusters at the natural frequencies as wide as their damping, as long as that is below half."""
    top = min(high, 1.0 / beam.viscosity_s) if beam.viscosity_s > 0.0 else high
    count = 3
    while beam.natural_rad_s(count)[-1] < top:
        count += max(4, count // 4)
    tones = beam.natural_rad_s(count)[2:]
    tones = tones[tones < top]
    widths = np.maximum(0.5 * beam.viscosity_s * tones**2, 1e-9 * tones)
    offsets = np.sinh(np.linspace(-8.0, 8.0, 121)) / 4.0
    clusters = (tones[:, None] + widths[:, None] * offsets).ravel()
    every = np.concatenate([np.geomspace(low, high, 2000), clusters])
    return np.unique(every[(every >= low) & (every <= high)])


def delay_margin_s(loci: Loci, damper_n_s_m: float) -> tuple[float, float]:
    """Largest pure delay that the loop bears, s, and the frequency that limits it, Hz; (inf, nan) without a crossing.

    The least phase above -pi over omega where |c lambda| = 1. A loop that still exceeds 1 at the grid's end is refused.
    """
    size = damper_n_s_m * np.abs(loci.values)
    if np.any(size[-1] > 1.0):
        raise SolverError("the loop gain is above 1 at the upper end of the frequencies: widen them")
    worst = (inf, float("nan"))
    for k in range(size.shape[1]):
        level = np.log(size[:, k])
        for i in np.flatnonzero((level[:-1] < 0.0) != (level[1:] < 0.0)):
            share = level[i] / (level[i] - level[i + 1])
            omega = loci.omega_rad_s[i] + share * (loci.omega_rad_s[i + 1] - loci.omega_rad_s[i])
            value = loci.values[i, k] + share * (loci.values[i + 1, k] - loci.values[i, k])
            delay = float(((np.angle(value) + pi) % (2.0 * pi)) / omega)
            worst = min(worst, (delay, float(omega / (2.0 * pi))))
    return worst


def gain_limit_n_s_m(loci: Loci, filtered: Filter) -> tuple[float, float]:
    """Largest damper c that a law c H(omega) bears, N s/m, and the frequency of the instability, Hz; (inf, nan) without.

    The least 1/|lambda H| where lambda H crosses the negative real axis: sure for a plant that is stable by itself.
    """
    values = loci.values * filtered(loci.omega_rad_s)[:, None]
    worst = (inf, float("nan"))
    for k in range(values.shape[1]):
        v = values[:, k]
        turned = (v.imag[:-1] < 0.0) != (v.imag[1:] < 0.0)
        for i in np.flatnonzero(turned):
            share = v.imag[i] / (v.imag[i] - v.imag[i + 1])
            real = v.real[i] + share * (v.real[i + 1] - v.real[i])
            if real < 0.0:
                omega = loci.omega_rad_s[i] + share * (loci.omega_rad_s[i + 1] - loci.omega_rad_s[i])
                worst = min(worst, (float(-1.0 / real), float(omega / (2.0 * pi))))
    return worst


def delayed(delay_s: float) -> Filter:
    """e^{-j omega delay}: a velocity loop that answers late."""
    return lambda omega: np.exp(-1j * omega * delay_s)


def demodulated(carrier_rad_s: float, window_s: float, delay_s: float = 0.0) -> Filter:
    """A loop on demodulated amplitudes: their mean over a window, then a delay, the carrier's own phase made good.

    H = (h(omega - carrier) - h(omega + carrier)) carrier/omega, h(d) = sinc(d window/2) e^{-j d (window/2 + delay)}: the
    second part is the image at minus the carrier; carrier/omega because displacement stands for velocity.
    """

    def mean(d: FloatArray) -> ComplexArray:
        return np.asarray(np.sinc(d * window_s / (2.0 * pi)) * np.exp(-1j * d * (window_s / 2.0 + delay_s)))

    return lambda omega: (mean(omega - carrier_rad_s) - mean(omega + carrier_rad_s)) * carrier_rad_s / omega


def instability_gain_n_s_m(beam: FreeBeam, layout: Layout, high_n_s_m: float, modes: int = MODES) -> float:
    """Least damper c up to `high` at which some pole crosses into growth, N s/m; inf when none does on a fine scan."""

    def growth(damper: float) -> float:
        return growth_per_s(beam, layout, damper, modes)[0]

    scan = np.geomspace(1e-9 * high_n_s_m, high_n_s_m, 91)
    for low, high in pairwise(scan):
        if growth(float(high)) > 0.0:
            return float(brentq(growth, low, high, rtol=1e-6)) if growth(float(low)) < 0.0 else float(low)
    return inf
