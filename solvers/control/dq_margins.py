"""Poles and margins of the sampled dq loop, exact for the envelope model; what phase and gain error of the carrier it bears.

z = e^{j Omega T} at the slow step's rate. The loop is complex when detuned: both signs of Omega are looked at.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import exp, inf, pi
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.control.dq_loop import Controller, Setup
from solvers.errors import SolverError

POINTS = 8000


@dataclass(frozen=True)
class SampledLoop:
    """Over envelope frequencies Omega (n,), rad/s, negative and positive: return ratio L at the plant's input, U/reference."""

    omega_rad_s: FloatArray
    open_loop: ComplexArray
    closed_loop: ComplexArray


@dataclass(frozen=True)
class Margins:
    """gain: factor on the plate's gain that brings the loop to its limit; phase_deg: error of the carrier's phase, the smaller
    of both signs; sensitivity: largest |1/(1 + L)|; poles (3,) of the closed loop in z.
    """

    gain: float
    phase_deg: float
    sensitivity: float
    poles: ComplexArray

    @property
    def stable(self) -> bool:
        """True when every pole lies inside the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    def to_dict(self) -> dict[str, Any]:
        """Numbers; poles as [re, im]; a gain without bound as null."""
        return {
            "gain": self.gain if np.isfinite(self.gain) else None,
            "phase_deg": self.phase_deg,
            "sensitivity": self.sensitivity,
            "stable": self.stable,
            "poles": [[pole.real, pole.imag] for pole in self.poles.tolist()],
        }


@dataclass(frozen=True)
class _Steps:
    """Over a period U' = a U + b V, in the middle of the window M = c U + e V, then V' = I - state M - feed V, I' = I - i M."""

    a: complex
    b: complex
    c: complex
    e: complex
    state: complex
    feed: complex
    integral: float


def _steps(setup: Setup, gain_error: complex) -> _Steps:
    rates, truth, model, control = setup.rates, setup.modes[setup.wanted], setup.model, Controller(setup)
    detuning = setup.omega_rad_s - truth.omega_rad_s
    rate = 1.0 / truth.tau_s + 1j * detuning
    turned = truth.gain * np.conj(model.gain) / abs(model.gain)  # the controller takes its idea of the phase out
    size = turned * gain_error / (1.0 + 1j * detuning * truth.tau_s)
    middle = (rates.period - rates.gap) / (2.0 * rates.sample_rate_hz)
    a, c = np.exp(-rate * rates.period_s), np.exp(-rate * middle)
    own = complex(control.states[0]), complex(control.feeds[0]), control.gains.integral
    return _Steps(a, size * (1 - a), c, size * (1 - c), *own)


def sampled_loop(setup: Setup) -> SampledLoop:
    """Return ratio and reference response from slow to half the slow step's rate, both signs of frequency."""
    steps, period = _steps(setup, 1.0), setup.rates.period_s
    half = np.geomspace(1e-4, 1.0, POINTS) * pi / period
    omega = np.concatenate([-half[::-1], half])
    z = np.exp(1j * omega * period)
    plant = steps.e + steps.c * steps.b / (z - steps.a)
    control = (steps.integral / (z - 1.0) + steps.state) / (z + steps.feed)
    loop = plant * control
    age = setup.rates.ahead_s / period
    forward = setup.gains.proportional + steps.integral * (1.0 - age + age / z) / (z - 1.0)
    return SampledLoop(omega, loop, plant * forward / (z + steps.feed) / (1.0 + loop))


def closed_loop_poles(setup: Setup, gain_error: complex = 1.0) -> ComplexArray:
    """Poles in z of (U, V, I), shape (3,); gain_error multiplies the plant (its phase: an error of the carrier's)."""
    s = _steps(setup, gain_error)
    matrix = np.array(
        [
            [s.a, s.b, 0.0],
            [-s.state * s.c, -s.state * s.e - s.feed, 1.0],
            [-s.integral * s.c, -s.integral * s.e, 1.0],
        ]
    )
    return np.asarray(np.linalg.eigvals(matrix))


def margins(setup: Setup) -> Margins:
    """Gain, phase and sensitivity of the sampled loop. SolverError when it is unstable to begin with."""
    poles = closed_loop_poles(setup)
    if not np.all(np.abs(poles) < 1.0):
        raise SolverError(f"the loop is unstable: a pole of size {np.abs(poles).max():.3f} a step")

    def stable(log_gain: float, phase: float) -> bool:
        return bool(np.all(np.abs(closed_loop_poles(setup, np.exp(log_gain + 1j * phase))) < 1.0))

    gain = _edge(lambda x: stable(x, 0.0), 0.0, 7.0)
    turned = _edge(lambda x: stable(0.0, x), 0.0, pi), _edge(lambda x: stable(0.0, -x), 0.0, pi)
    loop = sampled_loop(setup)
    return Margins(
        gain=exp(gain) if gain < inf else inf,
        phase_deg=float(np.degrees(min(*turned, pi))),
        sensitivity=float(np.abs(1.0 / (1.0 + loop.open_loop)).max()),
        poles=poles,
    )


def _edge(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Where a condition that holds at `low` first fails on a scan to `high`, by halving; inf if it never does."""
    scan = np.linspace(low, high, 181)
    for before, after in pairwise(scan):
        if not holds(float(after)):
            left, right = float(before), float(after)
            for _ in range(40):
                middle = 0.5 * (left + right)
                left, right = (middle, right) if holds(middle) else (left, middle)
            return left
    return inf
