"""Response of a plate to a periodic chirp, window by window, and the fit of one or two modes to it.

In the frame that rotates with the carrier, the envelope of a mode obeys tau dx/dt + (1 - j tau D) x = G u, where D is the
distance of its resonance from the carrier. The board holds the drive for a step of `every` windows and measures the
mean of x in the last one, from its second sample on. A periodic drive leaves lines at multiples of 1 / period, at which
the response below is exact, transients between steps and their images included.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from firmware.mode_table import MIN_MODE_HZ, PERIOD, RATE_HZ, WINDOW
from firmware.protocol import CHIRP_ROWS, Chirp

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SAMPLE_S = 1.0 / RATE_HZ["single"]
WINDOW_S = PERIOD * SAMPLE_S
TURN = 2**32
FULL_SCALE = 32767  # word of a response of 1
LEAST_STEPS, MOST_STEPS = 128, CHIRP_ROWS // 2  # two periods in a recording, or more
SETTLED, SLOW_SETTLED = 8.0, 5.0  # time constants in a period; of a plate that needs more than one window per step
FEW_FROM = 4  # windows per step from which half as many steps, each twice as long, save recordings
TRIES = (
    (0.0, 1.0),
    (0.7, 1.0),
    (-0.7, 1.0),
)  # first guesses of the second mode: distance in half-bandwidths, and damping


@dataclass(frozen=True)
class Sweep:
    """One period of a chirp over the whole band: steps, a power of two, of `every` windows about a carrier."""

    carrier_hz: float
    steps: int
    every: int = 1
    settle: int = 1  # periods before the recording

    @classmethod
    def for_tau(cls, carrier_hz: float, tau_s: float) -> Sweep:
        """Make the shortest sweep in which a mode of a time constant settles, near a carrier.

        A tone off the carrier leaves an image in the fit of a window, which turns by twice the carrier. An odd number of
        half turns per period removes it from the mean of two periods.
        """
        windows = SETTLED * tau_s / WINDOW_S
        steps = LEAST_STEPS
        while steps < min(windows, MOST_STEPS):
            steps *= 2
        every = max(1, math.ceil(windows / steps * (SLOW_SETTLED / SETTLED if windows > steps else 1.0)))
        if every >= FEW_FROM:
            steps = MOST_STEPS // 2
            every = math.ceil(SLOW_SETTLED * tau_s / WINDOW_S / steps)
        return cls._between_lines(carrier_hz, steps, every, 1)

    @classmethod
    def _between_lines(cls, carrier_hz: float, steps: int, every: int, settle: int) -> Sweep:
        turns = 2.0 * steps * every * WINDOW_S
        half = round(turns * carrier_hz - 0.5) + 0.5
        return cls((half if half >= turns * MIN_MODE_HZ else half + 1.0) / turns, steps, every, settle)

    @property
    def slow(self) -> bool:
        """True if a period is long enough to count each one."""
        return self.every >= FEW_FROM

    @property
    def coarser(self) -> Sweep:
        """Sweep of half the period if it is slow, settled for as long: half as many lines find a resonance as well."""
        if not self.slow:
            return self
        return self._between_lines(self.carrier_hz, self.steps, (self.every + 1) // 2, 2 * self.settle)

    def request(self, level: float) -> Chirp:
        """Return the request for this sweep, at a share of the drive limit, recorded from the second period on."""
        growth = TURN // self.steps
        return Chirp(
            self.carrier_hz,
            level,
            (TURN + growth // 2 - TURN // 2) % TURN,
            growth,
            self.steps,
            self.every,
            self.settle * self.steps,
        )

    @property
    def step_s(self) -> float:
        """Duration of a step, in s."""
        return self.every * WINDOW_S

    @cached_property
    def lines_hz(self) -> Floats:
        """Frequencies relative to the carrier, ascending, in Hz."""
        return np.fft.fftshift(np.fft.fftfreq(self.steps, self.step_s))

    @property
    def spacing_hz(self) -> float:
        """Distance of two lines, in Hz."""
        return 1.0 / (self.steps * self.step_s)

    def spectra(self, signal: Complexes) -> Complexes:
        """Return the lines of each whole period of a signal, (periods, lines)."""
        return np.fft.fftshift(np.fft.fft(signal.reshape(-1, self.steps)), axes=1)

    def responses(self, words: list[int], drive: float) -> Complexes:
        """Return sensor over drive, (periods, lines), from the recorded words and the drive's amplitude."""
        parts = np.array(words, np.uint16).view(np.int16).reshape(-1, 2) / FULL_SCALE
        given = self.request(0.0)
        index = np.arange(self.steps, dtype=object)
        phase = index * given.advance + index * (index - 1) // 2 * given.growth
        turns = np.array([int(value) % TURN / TURN for value in phase])
        return self.spectra(parts @ np.array([1.0, 1j])) / (drive * self.spectra(np.exp(2j * math.pi * turns)))


@dataclass(frozen=True)
class Mode:
    """Mode at a distance from the carrier: gain at its resonance, and relative standard deviations of tau and gain."""

    away_hz: float
    tau_s: float
    gain: complex = 1.0
    tau_error: float = 0.0
    gain_error: float = 0.0

    @property
    def half_hz(self) -> float:
        """Half-bandwidth in Hz."""
        return 1.0 / (2.0 * math.pi * self.tau_s)

    def response(self, lines_hz: Floats, step_s: float, late_s: float) -> Complexes:
        """Response of unit gain at lines relative to the carrier, for steps of a duration and a delay of the envelope.

        A step begins at t = 0 with the state x0: x = (x0 + 1/s) exp(s t) - 1/s with s = -1/tau + j D, scaled by 1/tau,
        and x(t - step) = exp(-j w step) x(t).
        """
        s = complex(-1.0 / self.tau_s, 2.0 * math.pi * self.away_hz)
        turn = np.exp(2j * math.pi * lines_hz * step_s)
        start = (np.exp(s * step_s) - 1.0) / s / (turn - np.exp(s * step_s)) + 1.0 / s
        at = step_s - PERIOD * SAMPLE_S + (np.arange(WINDOW) - 0.5) * SAMPLE_S - late_s
        old = at < 0.0
        grown = np.exp(s * np.where(old, at + step_s, at))
        mean_new, mean_old = grown[~old].sum() / WINDOW, grown[old].sum() / WINDOW
        share_old = old.mean()
        held = (mean_new + mean_old / turn) * start - (1.0 - share_old + share_old / turn) / s
        return np.asarray(held / self.tau_s)


@dataclass(frozen=True)
class Fit:
    """Modes on a smooth background, fitted to the lines within a span of the strongest one.

    Attributes
    ----------
    modes : tuple of Mode
        Strongest first.
    lines_hz, measured, model : ndarray, shape (lines,)
        Lines relative to the carrier, response without its delay, and the fitted one.
    background : ndarray, shape (2,)
        Constant, and slope over the span.
    delay_s : float
        Delay from drive to sensor, in s.
    """

    modes: tuple[Mode, ...]
    lines_hz: Floats
    measured: Complexes
    model: Complexes
    background: Complexes
    delay_s: float

    @property
    def misfit(self) -> float:
        """Rms deviation relative to the rms response."""
        return float(np.linalg.norm(self.model - self.measured) / np.linalg.norm(self.measured))


def without_delay(sweep: Sweep, response: Complexes, delay_s: float) -> Complexes:
    """Turn the response back by a delay."""
    return np.asarray(response * np.exp(2j * math.pi * (sweep.carrier_hz + sweep.lines_hz) * delay_s))


def fit(sweep: Sweep, response: Complexes, delay_s: float, first: Mode, count: int, span_hz: float) -> Fit:
    """Fit one or two modes and a linear background to a response, by separable least squares.

    The unknowns are the frequencies and the logarithms of the time constants; gains and background follow linearly.

    Parameters
    ----------
    sweep : Sweep
    response : ndarray, shape (lines,)
    delay_s : float
        Delay from drive to sensor, in s.
    first : Mode
        Guess of the strongest mode.
    count : int
        Number of modes, 1 or 2.
    span_hz : float
        Largest distance of a line from the guess.

    Returns
    -------
    Fit
    """
    from scipy.optimize import least_squares

    near = np.abs(sweep.lines_hz - first.away_hz) <= span_hz
    lines, late_s = sweep.lines_hz[near], delay_s
    measured = np.asarray(without_delay(sweep, response, delay_s)[near], complex)
    x = (lines - first.away_hz) / span_hz
    scale = np.abs(measured).max()

    def modes_of(p: Floats) -> list[Mode]:
        return [Mode(float(p[i] * first.half_hz), float(math.exp(p[i + 1]))) for i in range(0, len(p), 2)]

    def basis(p: Floats) -> Complexes:
        own = [mode.response(lines, sweep.step_s, late_s) for mode in modes_of(p)]
        return np.stack([*own, np.ones_like(x), x], axis=1)

    def residual(p: Floats) -> Floats:
        columns = basis(p)
        wrong = (columns @ np.linalg.lstsq(columns, measured, rcond=None)[0] - measured) / scale
        return np.concatenate([wrong.real, wrong.imag])

    start = [first.away_hz / first.half_hz, math.log(first.tau_s)]
    log_tau = (math.log(first.tau_s / 30.0), math.log(first.tau_s * 30.0))
    edges = [(lines[0] / first.half_hz, lines[-1] / first.half_hz), log_tau] * count
    guesses = (
        [start] if count == 1 else [[*start, *_second(lines, residual(np.array(start)), first, side)] for side in TRIES]
    )
    low, high = np.array(edges).T
    runs = [least_squares(residual, np.clip(guess, low + 1e-9, high - 1e-9), bounds=(low, high)) for guess in guesses]
    best = min(runs, key=lambda run: run.cost)
    columns = basis(best.x)
    weights = np.asarray(np.linalg.lstsq(columns, measured, rcond=None)[0], complex)
    errors = _errors(best.x, basis, weights, measured)
    found = [
        replace(mode, gain=complex(weights[i]), tau_error=errors[2 * i + 1], gain_error=errors[2 * count + i])
        for i, mode in enumerate(modes_of(best.x))
    ]
    found.sort(key=lambda mode: -abs(mode.gain))
    return Fit(tuple(found), lines, measured, columns @ weights, weights[count:], delay_s)


def _second(lines: Floats, wrong: Floats, first: Mode, side: tuple[float, float]) -> list[float]:
    """Guess a second mode: where the first one leaves most, or next to the first one."""
    left = np.abs(wrong[: len(lines)] + 1j * wrong[len(lines) :])
    away_hz = lines[left.argmax()] if side[0] == 0.0 else first.away_hz + side[0] * first.half_hz
    return [away_hz / first.half_hz, math.log(first.tau_s * side[1])]


def _errors(p: Floats, basis, weights: Complexes, measured: Complexes) -> list[float]:  # type: ignore[no-untyped-def]
    """Return standard deviations of the unknowns, and relative ones of the gains, from what the fit leaves."""
    count, step = len(p) // 2, 1e-6
    moved = [(basis(p + step * unit) - basis(p - step * unit)) @ weights / (2.0 * step) for unit in np.eye(len(p))]
    linear = [factor * column for column in basis(p).T for factor in (1.0, 1j)]
    jacobian = np.array([*moved, *linear]).T
    stacked = np.concatenate([jacobian.real, jacobian.imag])
    wrong = basis(p) @ weights - measured
    freedom = max(2 * len(measured) - stacked.shape[1], 1)
    sizes = np.linalg.norm(stacked, axis=0) + 1e-300
    inverse = np.linalg.pinv((stacked / sizes).T @ (stacked / sizes), rcond=1e-14)
    deviation = np.sqrt(np.maximum(np.diag(inverse), 0.0) * np.sum(np.abs(wrong) ** 2) / freedom) / sizes
    gains = [math.hypot(*deviation[len(p) + 2 * i : len(p) + 2 * i + 2]) / abs(weights[i]) for i in range(count)]
    return [*deviation[: len(p)].tolist(), *gains]
