"""Friction under a finger: a squeeze film's share of its load, and the net shear of a travelling wave."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, cos, pi, sin, sqrt

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError

# -- squeeze film ------------------------------------------------------------------------------------------------------
# Friction under a finger on a vibrating plate, as far as a squeeze film of air explains it.
# Air between plate and skin cannot escape within a period; its mean pressure exceeds that of the room by p0 (sqrt((1
# + 3/2 e^2)/(1 - e^2)) - 1) with e = amplitude over gap (salbu1964: isothermal, large squeeze number). What the film
# carries, the skin's asperities do not: mu/mu0 = 1 - film force/finger force (biet2007).

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


# -- shear of a travelling wave ----------------------------------------------------------------------------------------
# Net shear of a travelling wave on a finger at rest: the crests' speed along x, and what Coulomb friction makes of it.
# Points of the face move on ellipses: while a crest presses on the skin, the face runs against the wave with v =
# omega Im(U W*)/|W|, U and W its amplitudes along x and normal to it (of a thin plate U = (h/2) dW/dx). As in a
# travelling-wave motor (schmidt1996) the skin is an elastic layer under which the pressure is c (a cos theta - d),
# from the crest at theta = 0 to where it parts; Coulomb friction drives where the face runs one way and brakes where
# it runs the other.

MAX_WAVE_SHARE = 0.5  # of a wave, the widest contact that crests and troughs do not share


@dataclass(frozen=True)
class CrestMotion:
    """How the face moves along x under contacts, (nx, ny): at the crest, signed, and at most within a period, m/s."""

    crest_m_s: FloatArray
    most_m_s: FloatArray

    def lag(self, i: int, j: int) -> float:
        """Angle between a crest and the moment of the largest speed, 0 (a wave that travels) to pi/2 (one that stands)."""
        most = float(self.most_m_s[i, j])
        return acos(min(1.0, abs(float(self.crest_m_s[i, j])) / most)) if most > 0.0 else pi / 2.0


def crest_motion(along_m: ComplexArray, normal_m: ComplexArray, frequency_hz: float) -> CrestMotion:
    """From amplitudes u_x and u_z (nx, ny) in m, time convention e^{+j omega t}; 0 where nothing moves."""
    omega, size = 2.0 * pi * frequency_hz, np.abs(normal_m)
    turning = (along_m * normal_m.conj()).imag
    crest = np.divide(turning, size, out=np.zeros_like(size), where=size > 0.0)
    return CrestMotion(np.asarray(omega * crest), np.asarray(omega * np.abs(along_m)))


def contact_half_angle(load: float) -> float:
    """Half of the period's angle in which skin and face touch, rad, for load = dynamic stiffness times amplitude over force.

    The mean pressure bears the force: (sin t - t cos t)/pi = 1/load; pi up to a load of 1, where they never part.
    """
    if load <= 1.0:
        return pi
    from scipy.optimize import brentq

    return float(brentq(lambda t: (sin(t) - t * cos(t)) / pi - 1.0 / load, 1e-6, pi))


def drive_share(load: float, lag: float = 0.0) -> float:
    """Net shear over mu times the force, 0 to 1, of skin that slides all the time; `lag` as `CrestMotion.lag`.

    Limits of a wave that travels: 2 load/pi of a soft contact, 1 from a load of pi on, where only crests touch.
    """
    if load <= 1.0:
        return 2.0 * load * cos(lag) / pi
    half = contact_half_angle(load)
    low, high = max(-half, lag - pi / 2.0), min(half, lag + pi / 2.0)
    driving = (sin(high) - high * cos(half)) - (sin(low) - low * cos(half))
    return max(0.0, driving / (sin(half) - half * cos(half)) - 1.0)
