"""One mode in the frame that turns with its drive, the PI that controls it there, and what the drive's limit allows.

e^{+j omega t}; U = U_d + j U_q is the phasor of velocity (or of a signal that follows it), V that of the drive:
2 M dU/dt + (D + 2 j M d) U = N V, d = omega - omega_0, which is tau dU/dt + (1 + j tau d) U = G V.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, inf, isfinite, log, pi

import numpy as np
from numpy.typing import ArrayLike

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero, checked_frequencies

SETTLED = log(20.0)  # time constants of a first-order answer until 95 %


@dataclass(frozen=True)
class ModePlant:
    """frequency_hz omega_0/2 pi; tau_s = 2 M/D, decay of the amplitude; gain = N/D, signal per drive at resonance."""

    frequency_hz: float
    tau_s: float
    gain: complex

    def __post_init__(self) -> None:
        check_above_zero("mode: frequency in Hz", self.frequency_hz)
        check_above_zero("mode: tau in s", self.tau_s)
        if not (np.isfinite(self.gain) and self.gain != 0.0):
            raise SolverError(f"mode at {self.frequency_hz:g} Hz: gain {self.gain}: must be finite and other than 0")
        if self.omega_rad_s * self.tau_s <= 1.0:
            raise SolverError(
                f"mode at {self.frequency_hz:g} Hz: tau {self.tau_s:g} s leaves no oscillation (Q <= 1/2)"
            )

    @classmethod
    def from_quality_factor(cls, frequency_hz: float, quality_factor: float, gain: complex) -> ModePlant:
        """tau = 2 Q/omega_0. SolverError without losses (Q infinite: resonance has no bound) or for values not above 0."""
        check_above_zero("mode: frequency in Hz", frequency_hz)
        if not (isfinite(quality_factor) and quality_factor > 0.0):
            raise SolverError(
                f"quality factor {quality_factor:g}: must be finite and above 0; a mode without losses has no steady state"
            )
        return cls(frequency_hz, quality_factor / (pi * frequency_hz), gain)

    @property
    def omega_rad_s(self) -> float:
        """omega_0, rad/s."""
        return 2.0 * pi * self.frequency_hz

    @property
    def quality_factor(self) -> float:
        """Q = omega_0 tau/2."""
        return 0.5 * self.omega_rad_s * self.tau_s

    @property
    def bandwidth_rad_s(self) -> float:
        """2/tau = omega_0/Q: between the half-power points, which are also the extremes of U_q."""
        return 2.0 / self.tau_s

    def response(self, omega: ArrayLike) -> ComplexArray:
        """Exact velocity response G/(1 + j tau (omega^2 - omega_0^2)/(2 omega)), shape of omega."""
        return np.asarray(self.gain / (1.0 + 1j * self.tau_s * stretched_detuning(omega, self.omega_rad_s)))


def stretched_detuning(omega: ArrayLike, omega_0: float) -> FloatArray:
    """(omega^2 - omega_0^2)/(2 omega), rad/s: the detuning for which the circle of U is exact; near omega - omega_0."""
    w = checked_frequencies(omega)
    return np.asarray((w**2 - omega_0**2) / (2.0 * w))


@dataclass(frozen=True)
class Pi:
    """C(s) = K_p + K_i/s on each axis, drive per signal (and per second)."""

    proportional: float
    integral_per_s: float

    def closed_loop(
        self, plant: ModePlant, omega: ArrayLike, delay_s: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """Open-loop L and U/reference of the resonant axis at envelope frequencies omega (rad/s), with a delay."""
        s = 1j * np.asarray(omega, dtype=float)
        size = abs(plant.gain)
        loop = (self.proportional + self.integral_per_s / s) * size / (1.0 + plant.tau_s * s) * np.exp(-s * delay_s)
        return np.asarray(loop), np.asarray(loop / (1.0 + loop))


def pi_gains(plant: ModePlant, response_s: float) -> Pi:
    """Pole compensation: K_i = 1/(tau_d G), K_p = tau K_i with tau the plant's; the loop is 1/(tau_d s + 1).

    response_s is tau_d; 95 % are reached after tau_d ln 20. SolverError unless it is above 0.
    """
    check_above_zero("response in s", response_s)
    integral = 1.0 / (response_s * abs(plant.gain))
    return Pi(plant.tau_s * integral, integral)


@dataclass(frozen=True)
class SampledPi:
    """The PI of a step every T, as the firmware plans it, a = e^{-T/tau}, p = e^{-T/tau_d}; bounded: for the neighbours' sake.

    K_p = (1 - p)/((1 - a) G) with the integral (1 - a) K_p a step cancels the plant's pole a and leaves p.
    """

    proportional: float
    integral: float
    bounded: bool


def sampled_gains(plant: ModePlant, response_s: float, period_s: float, proportional_max: float = inf) -> SampledPi:
    """Gains of the sampled loop; K_p at most proportional_max and at least a tenth of 1/G. SolverError as pi_gains."""
    check_above_zero("response, period in s", response_s, period_s)
    pole, wanted = exp(-period_s / plant.tau_s), exp(-period_s / response_s)
    size = abs(plant.gain)
    proportional = (1.0 - wanted) / ((1.0 - pole) * size)
    bounded = max(min(proportional, proportional_max), 0.1 / size)
    return SampledPi(bounded, (1.0 - pole) * bounded, bounded < proportional)


@dataclass(frozen=True)
class Feasibility:
    """What an amplitude asks of the drive: held, and at its peak while rising with tau_d; both in units of the drive.

    largest_reference: up to where tau_d is kept; least_time_s: to 95 % at full drive, inf beyond what can be held.
    """

    reference: float
    response_s: float
    steady_drive: float
    peak_drive: float
    largest_reference: float
    least_time_s: float
    drive_limit: float

    @property
    def feasible(self) -> bool:
        """True when the drive never meets its limit."""
        return self.peak_drive <= self.drive_limit


def feasibility(
    plant: ModePlant, reference: float, response_s: float, drive_limit: float, detuning_rad_s: float = 0.0
) -> Feasibility:
    """Drive for U = r (1 - e^{-t/tau_d}): |V| = |tau U' + (1 + j tau d) U|/G, largest at one of its ends.

    At full drive |U| can rise as G V (1 - e^{-t/tau}) whatever the detuning, for the drive may turn with the mode; 95 % then
    take -tau ln(1 - 0.95 r/(G V)). SolverError unless reference, tau_d and limit are above 0.
    """
    check_above_zero("reference, response, drive limit", reference, response_s, drive_limit)
    size = abs(plant.gain)
    detuned = abs(1.0 + 1j * plant.tau_s * detuning_rad_s)
    peak = max(plant.tau_s / response_s, detuned)
    reach = size * drive_limit
    within = reference * detuned <= reach
    return Feasibility(
        reference=reference,
        response_s=response_s,
        steady_drive=detuned * reference / size,
        peak_drive=peak * reference / size,
        largest_reference=reach / peak,
        least_time_s=-plant.tau_s * log(1.0 - 0.95 * reference / reach) if within else inf,
        drive_limit=drive_limit,
    )
