"""Friction under a finger on a vibrating plate, as far as a squeeze film of air explains it.

Air between plate and skin cannot escape within a period; its mean pressure exceeds that of the room by
p0 (sqrt((1 + 3/2 e^2)/(1 - e^2)) - 1) with e = amplitude over gap (salbu1964: isothermal, large squeeze number). What the film
carries, the skin's asperities do not: mu/mu0 = 1 - film force/finger force (biet2007).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

from solvers.errors import SolverError

PRESSURE_PA = 101325.0
VISCOSITY_PA_S = 1.81e-5  # of air at 20 C
FREE_PATH_M = 68e-9  # of its molecules at 1 atm
MIN_SQUEEZE_NUMBER = 10.0  # below it air escapes at the rim within a period
MAX_KNUDSEN = 0.1  # above it the film is no continuum


class OutOfValidity(SolverError):
    """The relation does not hold there: the text says which limit is broken, and by what."""


@dataclass(frozen=True)
class SqueezeFilm:
    """Air between a plate and a finger: mean gap in m, the contact's radius in m, the finger's normal force in N."""

    gap_m: float
    radius_m: float
    force_n: float

    def squeeze_number(self, frequency_hz: float) -> float:
        """12 eta omega R^2/(p0 gap^2)."""
        return 24.0 * pi * frequency_hz * VISCOSITY_PA_S * (self.radius_m / self.gap_m) ** 2 / PRESSURE_PA

    def lift_n(self, amplitude_m: float) -> float:
        """Mean force of the film, N, for a peak amplitude below the gap."""
        share = (amplitude_m / self.gap_m) ** 2
        return PRESSURE_PA * pi * self.radius_m**2 * (sqrt((1.0 + 1.5 * share) / (1.0 - share)) - 1.0)

    def friction_ratio(self, amplitude_m: float, frequency_hz: float) -> float:
        """mu over mu of the plate at rest, from 0 to 1, for a peak amplitude; OutOfValidity where the relation says nothing."""
        gap = f"a gap of {1e6 * self.gap_m:.3g} um"
        if MAX_KNUDSEN * self.gap_m < FREE_PATH_M:
            raise OutOfValidity(
                f"{gap} is no continuum of air: it must be above {1e6 * FREE_PATH_M / MAX_KNUDSEN:.2g} um"
            )
        number = self.squeeze_number(frequency_hz)
        if number < MIN_SQUEEZE_NUMBER:
            raise OutOfValidity(
                f"air escapes from {gap}: squeeze number {number:.2g}, must be {MIN_SQUEEZE_NUMBER:g} or more"
            )
        if amplitude_m >= self.gap_m:
            raise OutOfValidity(f"an amplitude of {1e6 * amplitude_m:.3g} um is not below {gap}")
        lift = self.lift_n(amplitude_m)
        if lift > self.force_n:
            raise OutOfValidity(
                f"at an amplitude of {1e6 * amplitude_m:.3g} um {gap} would carry {lift:.3g} N, more than the finger's "
                f"{self.force_n:g} N: it floats, and the gap is not the given one"
            )
        return 1.0 - lift / self.force_n
