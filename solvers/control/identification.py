"""A mode identified from a frequency response: resonance, time constant, gain, delay and quality factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from geometry.elements import ComplexArray, FloatArray
from solvers.control.loop import ModePlant, stretched_detuning
from solvers.errors import SolverError

# -- circle and phase --------------------------------------------------------------------------------------------------
# Frequency, time constant, gain and delay of a mode from its frequency response: circle fit, then phase fit.
# U = e^{-j omega delay} (G/(1 + j tau x) + background), x = (omega^2 - omega_0^2)/(2 omega): once the delay is out, a
# circle of diameter |G| whose polar angle about its centre is theta = theta_0 - 2 atan(tau x).

Sensor = Literal["velocity", "displacement"]
MISFIT_MAX = 0.05  # rms distance from the circle over its radius
ROUNDING_TURNS = 0.01
SIGMAS = 2.0  # standard deviations in a half-width
ARC_MIN = pi / 2.0  # of the circle that the sweep must cover


@dataclass(frozen=True)
class Sweep:
    """frequencies_hz (n,), ascending, and response (n,), signal over drive."""

    frequencies_hz: FloatArray
    response: ComplexArray

    def __post_init__(self) -> None:
        f, h = self.frequencies_hz, self.response
        if f.ndim != 1 or f.shape != h.shape or f.size < 8:
            raise SolverError("a sweep needs at least 8 frequencies and as many responses")
        if not (np.all(np.isfinite(f)) and np.all(np.isfinite(h)) and np.all(np.diff(f) > 0.0) and f[0] > 0.0):
            raise SolverError("a sweep's values must be finite, its frequencies ascending and above 0")


@dataclass(frozen=True)
class Circle:
    """Centre and radius of points of a complex plane, rms distance of the points from it over the radius."""

    centre: complex
    radius: float
    misfit: float


@dataclass(frozen=True)
class Identified:
    """The mode as seen through the drive and the sensor: its gain's phase is the part that the delay does not explain.

    background: the rest far from resonance; circle: of the response with the delay taken out. frequency_error,
    quality_error: relative error bars (half-widths) due to the scatter of the points, None for too few.
    """

    plant: ModePlant
    delay_s: float
    background: complex
    circle: Circle
    frequency_error: float | None = None
    quality_error: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Frequency in Hz, times in s."""
        own = {"delay_s": self.delay_s, "background": self.background, "circle": self.circle}
        return {name: getattr(self.plant, name) for name in ("frequency_hz", "tau_s", "quality_factor", "gain")} | own


def _fit_circle(points: ComplexArray) -> Circle:
    """Circle of points (n,) by least squares: an algebraic start |z|^2 + b x + c y + d = 0, then the distances.

    SolverError for fewer than 4 points, or points on a line.
    """
    if points.size < 4:
        raise SolverError(f"a circle needs at least 4 points, not {points.size}")
    middle = points.mean()
    size = float(np.abs(points - middle).max())
    if size == 0.0:
        raise SolverError("all points of the circle are one point")
    z = (points - middle) / size
    matrix = np.column_stack([z.real, z.imag, np.ones(z.size)])
    (b, c, d), _, rank, values = np.linalg.lstsq(matrix, -(np.abs(z) ** 2), rcond=None)
    if rank < 3 or values[-1] < 1e-9 * values[0]:
        raise SolverError("the points lie on a line, not on a circle")
    start = np.array([-b / 2.0, -c / 2.0, np.sqrt(max(b**2 / 4.0 + c**2 / 4.0 - d, 1e-30))])

    def distances(p: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(z.real - p[0], z.imag - p[1]) - p[2])

    fit = least_squares(distances, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    x, y, radius = fit.x
    misfit = float(np.sqrt(np.mean(fit.fun**2)) / abs(radius))
    return Circle(complex(middle + size * (x + 1j * y)), float(size * abs(radius)), misfit)


def _fit_phase(frequencies_hz: FloatArray, angles: FloatArray) -> tuple[float, float, float]:
    """Resonance in Hz, tau in s and theta_0 of theta = theta_0 - 2 atan(tau (omega^2 - omega_0^2)/(2 omega)).

    Fitted to unwrapped angles (n,) about a circle, in rad, at ascending frequencies (n,).
    """
    f = frequencies_hz
    steepest = int(np.argmax(np.abs(np.diff(angles) / np.diff(f))))
    start_hz = 0.5 * (f[steepest] + f[steepest + 1])
    slope = abs(angles[steepest + 1] - angles[steepest]) / (2.0 * pi * (f[steepest + 1] - f[steepest]))
    span = f[-1] - f[0]
    start = np.array([0.0, np.log(max(slope / 2.0, 1e-12)), float(np.interp(start_hz, f, angles))])

    def residual(p: FloatArray) -> FloatArray:
        x = stretched_detuning(2.0 * pi * f, 2.0 * pi * (start_hz + p[0] * span))
        return np.asarray(p[2] - 2.0 * np.arctan(np.exp(p[1]) * x) - angles)

    fit = least_squares(residual, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return float(start_hz + fit.x[0] * span), float(np.exp(fit.x[1])), float(fit.x[2])


def identify(sweep: Sweep, sensor: Sensor = "velocity", delay_s: float = 0.0) -> Identified:
    """Identify the mode of a sweep across its resonance.

    A real mode's gain has the phase 0 or pi for velocity, and -pi/2 or pi/2 for displacement (that response is multiplied by
    j omega/omega_0). A remaining phase within a quarter of a turn is attributed to an unknown delay.

    Parameters
    ----------
    sweep : Sweep
        Frequencies in Hz and the complex response.
    sensor : {"velocity", "displacement"}, optional
        Quantity that the response measures.
    delay_s : float, optional
        Known part of the delay.

    Returns
    -------
    Identified
        Mode, delay, background and circle, with errors from the scatter of the points.

    Raises
    ------
    SolverError
        If the points do not form a circle, or cover less than a quarter of one.
    """
    velocity = _as_velocity(sweep, sensor)
    for _ in range(3):
        plant = _fit(sweep.frequencies_hz, velocity, delay_s)[0]
        phase_left = (np.angle(plant.gain) + pi / 2.0) % pi - pi / 2.0
        delay_s = float(delay_s - phase_left / plant.omega_rad_s)
    if delay_s < 0.0:  # noise around no circle, or less than half a turn
        delay_s = 0.0 if delay_s * plant.frequency_hz > -ROUNDING_TURNS else delay_s + 0.5 / plant.frequency_hz
    plant, background, circle = _fit(sweep.frequencies_hz, velocity, delay_s)
    errors = _by_scatter(sweep.frequencies_hz, _advanced(sweep.frequencies_hz, velocity, delay_s), plant, background)
    if sensor == "displacement":
        plant, background = ModePlant(plant.frequency_hz, plant.tau_s, -1j * plant.gain), -1j * background
    return Identified(plant, delay_s, background, circle, *errors)


def _by_scatter(
    frequencies_hz: FloatArray, straight: ComplexArray, plant: ModePlant, background: complex
) -> tuple[float | None, float | None]:
    """Relative half-widths of frequency and quality factor: SIGMAS deviations of a fit of f0, tau, gain and background."""
    omega, own = 2.0 * pi * frequencies_hz, plant.omega_rad_s
    fall = 1.0 / (1.0 + 1j * plant.tau_s * stretched_detuning(omega, own))
    by_tau = -1j * plant.gain * plant.tau_s * stretched_detuning(omega, own) * fall**2
    by_tone = 1j * plant.gain * plant.tau_s * own**2 / omega * fall**2
    one = np.ones_like(fall) * abs(plant.gain)
    steps = np.column_stack([by_tone, by_tau, fall * plant.gain, 1j * fall * plant.gain, one, 1j * one])
    free = 2 * len(omega) - steps.shape[1]
    if free < 1:
        return None, None
    rest = straight - plant.gain * fall - background
    deviation = np.sqrt((np.abs(rest) ** 2).sum() / free)
    spread = deviation * np.linalg.pinv(np.vstack([steps.real, steps.imag]))
    return float(SIGMAS * np.linalg.norm(spread[0])), float(SIGMAS * np.linalg.norm(spread[0] + spread[1]))


def _as_velocity(sweep: Sweep, sensor: Sensor) -> ComplexArray:
    if sensor not in ("velocity", "displacement"):
        raise SolverError(f"sensor {sensor!r}: must be velocity or displacement")
    if sensor == "velocity":
        return sweep.response
    centre = sweep.frequencies_hz[int(np.argmax(np.abs(sweep.response)))]
    return np.asarray(1j * sweep.frequencies_hz / centre * sweep.response)


def _advanced(frequencies_hz: FloatArray, response: ComplexArray, delay_s: float) -> ComplexArray:
    return np.asarray(response * np.exp(2j * pi * frequencies_hz * delay_s))


def _fit(frequencies_hz: FloatArray, response: ComplexArray, delay_s: float) -> tuple[ModePlant, complex, Circle]:
    straight = _advanced(frequencies_hz, response, delay_s)
    circle = _fit_circle(straight)
    angles = np.unwrap(np.angle(straight - circle.centre))
    if circle.misfit > MISFIT_MAX:
        raise SolverError(
            f"the response is not a circle: its points lie {100 * circle.misfit:.1f} % of the radius off it"
        )
    if np.ptp(angles) < ARC_MIN:
        raise SolverError(
            f"the sweep covers {np.degrees(np.ptp(angles)):.0f} degrees of the circle, at least 90 are needed"
        )
    frequency, tau, theta = _fit_phase(frequencies_hz, angles)
    gain = 2.0 * circle.radius * np.exp(1j * theta)
    return ModePlant(frequency, tau, complex(gain)), complex(circle.centre - gain / 2.0), circle


def sweep_of(
    modes: Sequence[ModePlant],
    frequencies_hz: FloatArray,
    sensor: Sensor = "velocity",
    delay_s: float = 0.0,
    feedthrough: complex = 0.0,
) -> Sweep:
    """Compute the steady response of several modes through a delay.

    Parameters
    ----------
    modes : sequence of ModePlant
        Their responses are added.
    frequencies_hz : ndarray, shape (n,)
        Frequencies of the sweep.
    sensor : {"velocity", "displacement"}, optional
        Displacement divides each mode by j omega/omega_n, so that its gain keeps its size.
    delay_s : float, optional
        Delay of the whole response.
    feedthrough : complex, optional
        Constant part of the response, in its unit.

    Returns
    -------
    Sweep
        The frequencies with the complex response (n,).
    """
    omega = 2.0 * pi * np.asarray(frequencies_hz, dtype=float)
    total = np.full(omega.shape, feedthrough, dtype=complex)
    for mode in modes:
        total += mode.response(omega) * (mode.omega_rad_s / (1j * omega) if sensor == "displacement" else 1.0)
    return Sweep(np.asarray(frequencies_hz, dtype=float), total * np.exp(-1j * omega * delay_s))


def noisy(sweep: Sweep, rms: float, seed: int = 1) -> Sweep:
    """Add circular complex Gaussian noise to every point of a sweep.

    Parameters
    ----------
    sweep : Sweep
        Response without noise.
    rms : float
        Root mean square of the noise, in the unit of the response.
    seed : int, optional
        Seed of the random numbers.

    Returns
    -------
    Sweep
        The same frequencies with the noisy response.
    """
    random, shape = np.random.default_rng(seed), sweep.response.shape
    scatter = rms * (random.normal(size=shape) + 1j * random.normal(size=shape)) / np.sqrt(2.0)
    return Sweep(sweep.frequencies_hz, sweep.response + scatter)


# -- measured sweeps ---------------------------------------------------------------------------------------------------
# Peak, frequency and quality factor of a measured sweep: circle fit about its highest point, and its half-power
# width.

FLOOR = 0.5  # of the peak: points about it that reach so high, 240 degrees of a single mode's circle, are fitted
MIN_COUNT = 8


@dataclass(frozen=True)
class Resonance:
    """A sweep's highest point and the mode identified around it.

    frequency_hz, quality_factor: the circle's, or the highest point and the half-power width where there is no circle
    (`trouble` says why); low_hz, high_hz: range of the circle fit. frequency_error: relative error bar of frequency_hz: the
    circle's, or the distance from the highest point to its neighbours; None if unknown, as at an end of the sweep.
    """

    peak_hz: float
    frequency_hz: float
    quality_factor: float | None
    half_power_quality_factor: float | None
    circle: Identified | None
    low_hz: float
    high_hz: float
    trouble: str | None
    frequency_error: float | None


def resonance(sweep: Sweep, sensor: Sensor) -> Resonance:
    """Identify the mode at a sweep's highest point.

    Parameters
    ----------
    sweep : Sweep
        Frequencies in Hz and the complex response.
    sensor : {"velocity", "displacement"}
        Quantity that the response measures.

    Returns
    -------
    Resonance
        Peak, frequency and quality factor; from the half-power width if no circle fits, with the reason.

    References
    ----------
    .. [1] ewins2000 (docs/references.bib)
    """
    amplitude = np.abs(sweep.response)
    peak = int(np.argmax(amplitude))
    low, high = _about(amplitude, peak)
    part = Sweep(sweep.frequencies_hz[low:high], sweep.response[low:high])
    half = half_power_quality_factor(sweep.frequencies_hz, amplitude, peak)
    identified, trouble = None, None
    try:
        identified = identify(part, sensor)
        tone = identified.plant.frequency_hz
        if not part.frequencies_hz[0] <= tone <= part.frequencies_hz[-1]:
            raise SolverError(f"the circle's frequency {tone:.1f} Hz lies outside the fitted range")
    except SolverError as fault:
        identified, trouble = None, str(fault)
    peak_hz = float(sweep.frequencies_hz[peak])
    found = identified.plant if identified else None
    tone, quality = (found.frequency_hz, found.quality_factor) if found else (peak_hz, half)
    low_hz, high_hz = float(part.frequencies_hz[0]), float(part.frequencies_hz[-1])
    error = identified.frequency_error if identified else _between_points(sweep.frequencies_hz, peak)
    return Resonance(peak_hz, tone, quality, half, identified, low_hz, high_hz, trouble, error)


def _between_points(frequencies_hz: FloatArray, peak: int) -> float | None:
    """How far a maximum may lie from the highest point, relative; None at an end, beyond which it may lie anywhere."""
    if not 0 < peak < len(frequencies_hz) - 1:
        return None
    return float(np.diff(frequencies_hz[peak - 1 : peak + 2]).max() / frequencies_hz[peak])


def _about(amplitude: FloatArray, peak: int) -> tuple[int, int]:
    """The unbroken range about the peak above the floor, widened evenly to the points that a fit needs."""
    above = amplitude >= FLOOR * amplitude[peak]
    low = peak - int(np.argmin(above[peak::-1])) + 1 if not above[: peak + 1].all() else 0
    high = peak + int(np.argmin(above[peak:])) if not above[peak:].all() else len(amplitude)
    while high - low < min(MIN_COUNT, len(amplitude)):
        low, high = max(0, low - 1), min(len(amplitude), high + 1)
    return low, high


def half_power_quality_factor(frequency_hz: FloatArray, amplitude: FloatArray, peak: int) -> float | None:
    """Divide the frequency of a peak by its width at 1/sqrt(2) of its height.

    Parameters
    ----------
    frequency_hz, amplitude : ndarray, shape (n,)
        The curve; amplitudes in any one unit.
    peak : int
        Index of the peak.

    Returns
    -------
    float or None
        Quality factor, dimensionless; None if a side does not fall that far.
    """
    ends = half_power_points(frequency_hz, amplitude, peak)
    return None if ends is None else float(frequency_hz[peak] / (ends[1] - ends[0]))


def half_power_points(frequency_hz: FloatArray, amplitude: FloatArray, peak: int) -> tuple[float, float] | None:
    """Interpolate where a curve crosses 1/sqrt(2) of its peak, below and above it.

    Parameters
    ----------
    frequency_hz, amplitude : ndarray, shape (n,)
        The curve; amplitudes in any one unit.
    peak : int
        Index of the peak.

    Returns
    -------
    tuple of float, or None
        Both frequencies in Hz; None if a side does not fall that far.
    """
    from scipy.signal import (
        peak_widths,  # half a second to import, which a response without such a curve need not wait for
    )

    last = len(amplitude) - 1
    if max(amplitude[: peak + 1].min(), amplitude[peak:].min()) > amplitude[peak] / np.sqrt(2.0):
        return None
    bases = (amplitude[[peak]], np.array([0]), np.array([last]))
    _, _, *ends = peak_widths(amplitude, [peak], 1.0 - np.sqrt(0.5), prominence_data=bases)
    low, high = np.interp(np.concatenate(ends), np.arange(last + 1), frequency_hz)
    return float(low), float(high)
