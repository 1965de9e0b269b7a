"""Net shear of a travelling wave on a finger at rest: the crests' speed along x, and what Coulomb friction makes of it.

Points of the face move on ellipses: while a crest presses on the skin, the face runs against the wave with
v = omega Im(U W*)/|W|, U and W its amplitudes along x and normal to it (of a thin plate U = (h/2) dW/dx). As in a
travelling-wave motor (schmidt1996) the skin is an elastic layer under which the pressure is c (a cos theta - d), from the crest
at theta = 0 to where it parts; Coulomb friction drives where the face runs one way and brakes where it runs the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, cos, pi, sin

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.point import face_motion

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


def motion_along(forced: ForcedPlate, points_m: FloatArray, frequency_hz: float) -> ComplexArray:
    """u_x per volt of drive of a plate at points (p, 2) in m of its touch face, (p,)."""
    eigenvalue = forced.plate.scale.eigenvalue(frequency_hz)
    volts = forced.volts(eigenvalue)
    moved = [
        face_motion(basis.group, points_m, 0) @ (basis.columns @ basis.amplitudes(eigenvalue, forced.loss, volts))
        for basis in forced.modes
    ]
    return np.asarray(np.sum(moved, axis=0), dtype=complex)


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
