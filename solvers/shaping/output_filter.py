"""The low-pass filter between a half-bridge and its patch, and what undoes its phase.

F(s) = 1/(L C s^2 + R C s + 1), C the patch's capacitance; the corner 1/(2 pi sqrt(LC)) is in Hz. A patch on a moving beam is no
plain capacitor: with the capacitance matrix C(omega) of all patches, (I + (i omega R - omega^2 L) C) V = V_command.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from geometry.elements import ComplexArray
from solvers.errors import SolverError, check_above_zero


@dataclass(frozen=True)
class LowPass:
    """inductance_h L, resistance_ohm R, capacitance_f C of the clamped patch; all above 0."""

    inductance_h: float
    resistance_ohm: float
    capacitance_f: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_above_zero(f"filter: {name}", value)

    @property
    def corner_hz(self) -> float:
        """1/(2 pi sqrt(LC)), Hz."""
        return 1.0 / (2.0 * pi * sqrt(self.inductance_h * self.capacitance_f))

    @property
    def quality_factor(self) -> float:
        """sqrt(L/C)/R; 1/sqrt(2) is maximally flat."""
        return sqrt(self.inductance_h / self.capacitance_f) / self.resistance_ohm

    def response(self, frequency_hz: float) -> complex:
        """F(i omega); SolverError for a frequency that is not above 0."""
        return 1.0 / (1.0 + self.capacitance_f * self._impedance(frequency_hz))

    def loaded_response(self, frequency_hz: float, capacitance: ComplexArray) -> ComplexArray:
        """V over V_command (a, a) with every patch on its own filter and C(omega) (a, a) in place of C.

        SolverError for a frequency that is not above 0.
        """
        return np.asarray(np.linalg.inv(np.eye(len(capacitance)) + self._impedance(frequency_hz) * capacitance))

    def compensation(self, frequency_hz: float) -> complex:
        """1/F(i omega): the factor on each command that undoes gain and phase of the unloaded filter."""
        return 1.0 / self.response(frequency_hz)

    def _impedance(self, frequency_hz: float) -> complex:
        """s R + s^2 L: voltage lost per charge."""
        check_above_zero("frequency in Hz", frequency_hz)
        s = 2j * pi * frequency_hz
        return self.resistance_ohm * s + self.inductance_h * s**2


def filter_for(capacitance_f: float, highest_hz: float, pwm_hz: float, quality_factor: float = sqrt(0.5)) -> LowPass:
    """L and R for a corner half-way (geometrically) between the highest operating and the PWM frequency.

    SolverError unless 0 < highest_hz < pwm_hz and the quality factor is above 0.
    """
    if not 0.0 < highest_hz < pwm_hz:
        raise SolverError(
            f"filter: needs 0 < highest operating frequency < PWM frequency, {highest_hz:g} and {pwm_hz:g} Hz came"
        )
    check_above_zero("filter: quality factor, capacitance", quality_factor, capacitance_f)
    corner = 2.0 * pi * sqrt(highest_hz * pwm_hz)
    inductance = 1.0 / (corner**2 * capacitance_f)
    return LowPass(inductance, sqrt(inductance / capacitance_f) / quality_factor, capacitance_f)
