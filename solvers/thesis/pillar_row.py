"""A row of the design's pillars as a filter for flexural waves on the strip of plate that carries it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan, pi

import numpy as np
from numpy.typing import ArrayLike

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from solvers.analytic.predesign import pillar_beam, pillar_frequencies_hz
from solvers.analytic.timoshenko import Beam
from solvers.errors import SolverError, checked_frequencies
from solvers.thesis.scattering import (
    HostBeam,
    decay_db_per_row,
    half_power_band,
    moment_total_reflection_rad_s,
    oscillator_total_reflection_rad_s,
    scatter,
)

# -- stiffness at the foot ---------------------------------------------------------------------------------------------
# What a structure feels of a resonator standing on it: dynamic stiffness at the foot, time factor e^{-i omega t}.
# A stiffness K makes the resonator pull back with force -K w and moment -K theta; losses give K a negative imaginary
# part.


def pillar_foot(beam: Beam, omega: ArrayLike, axial_n: float, loss: float = 0.0, lever_m: float = 0.0) -> ComplexArray:
    """A pillar on its foot, its tip free or with a rigid body on it, shape (n, 2, 2): bending by the foot's rotation,
    stretching by its deflection.

    beam: the pillar (uniform; shear_n = inf and rotary_kg_m = 0 make it Euler-Bernoulli's); axial_n: EA in N; loss eta:
    E (1 - i eta); lever_m: height of the foot above the host's neutral line, which stays at rest along x.
    K_ww = -rho A omega^2 h B/(kh), k^2 = rho A omega^2/EA, B = tan(kh) without a body on the tip, with one of M = m rho A h
    (sin kh + m kh cos kh)/(cos kh - m kh sin kh); K_tt = D_tt + 2 e D_ut + e^2 D_uu with the bending
    stiffness D of the foot. N/m, N m.
    """
    w = np.atleast_1d(checked_frequencies(omega))
    foot = np.zeros((w.size, 2, 2), dtype=complex)
    phase = w * beam.length_m * np.sqrt(beam.mass_kg_m / (axial_n * (1.0 - 1j * loss)))
    heavy = np.tan(phase)
    if beam.end is not None:
        transmitted = beam.end_shares[0] * phase
        heavy = (heavy + transmitted) / (1.0 - transmitted * heavy)
    foot[:, 0, 0] = -beam.mass_kg_m * beam.length_m * w**2 * heavy / phase
    bending = np.stack([bending_foot(beam, value, loss) for value in w])
    foot[:, 1, 1] = bending[:, 1, 1] + 2.0 * lever_m * bending[:, 0, 1] + lever_m**2 * bending[:, 0, 0]
    return foot


def bending_foot(beam: Beam, omega: float, loss: float = 0.0) -> ComplexArray:
    """Dynamic stiffness of a uniform beam's end s = 0, other end free or with a rigid body, over (displacement, rotation),
    shape (2, 2).

    From the four exact waves exp(lambda s), lambda^4 + (b + r O^2) lambda^2 + r O^2 b - O^2 = 0, O the dimensionless
    frequency with E (1 - i loss). Euler-Bernoulli: K_tt = -EI beta (sin cosh - cos sinh)/(1 + cos cosh) of beta L.
    """
    if beam.width_ratio is not None:
        raise SolverError("a tapered pillar has no exact foot stiffness")
    lossy = 1.0 - 1j * loss
    square = (omega / beam.unit_rad_s) ** 2 / lossy
    b, turn = beam.flexibility * square, beam.rotation * square
    half = (b + turn) / 2.0
    root = np.sqrt(half**2 - turn * b + square)
    trig = half + root
    lambdas = np.array([np.sqrt(-trig), -np.sqrt(-trig), *(sign * np.sqrt(root - half) for sign in (1, -1))])
    anchor = np.where(lambdas.real > 0.0, 1.0, 0.0)  # growing waves are counted from the far end
    tilt = (lambdas**2 + b) / lambdas

    def at(s: float) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
        wave = np.exp(lambdas * (s - anchor))
        return wave, tilt * wave, tilt * lambdas * wave, (square / lambdas) * wave  # w, psi, psi', shear force/EI

    far, near = at(1.0), at(0.0)
    mass, inertia, arm = beam.end_shares
    lifted = square * mass * (far[0] + arm * far[1])
    moment_free, shear_free = far[2] - square * inertia * far[1] - arm * lifted, far[3] + lifted
    waves = np.linalg.solve(np.stack([near[0], near[1], moment_free, shear_free]), np.eye(4)[:, :2])
    length, stiff = beam.length_m, beam.bending_n_m2 * lossy
    moment, shear = -stiff / length**2 * (near[2] @ waves), stiff / length**3 * (near[3] @ waves)
    return np.stack([[shear[0], shear[1] * length], [moment[0], moment[1] * length]])


# -- rows --------------------------------------------------------------------------------------------------------------
# A row of the design's pillars as a filter for flexural waves on the strip of plate that carries it.

DECAYS_DB = 0.01  # a row: below it a wave counts as passing


@dataclass(frozen=True)
class PillarFilter:
    """Over n frequencies: |t|^2 and |r|^2 of 1 ... rows pillars, shape (rows, n), decay of an endless row (n,), dB.

    clamped_hz: the pillar on a rigid foot (Timoshenko); stopped_hz: where one pillar's moment lets nothing through;
    oscillator_stopped_hz: the same for a vertical oscillator of the pillar's mass and clamped frequency. bands_hz: the
    widest stretch with |t|^2 <= 1/2 for 1 ... rows pillars; stop_hz: the widest in which the endless row lets no wave
    through without losses (decay above 0.01 dB a row); None without any in the window.
    """

    frequencies_hz: FloatArray
    transmitted: FloatArray
    reflected: FloatArray
    decay_db: FloatArray
    clamped_hz: float
    stopped_hz: float
    oscillator_stopped_hz: float
    bands_hz: tuple[tuple[float, float] | None, ...]
    stop_hz: tuple[float, float] | None

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """The first of bands_hz: one pillar."""
        return self.bands_hz[0]


def strip_beam(design: Design) -> HostBeam:
    """The strip of one pitch: bending stiffness D pitch of a plate kept straight along x."""
    stack, width = design.stack, design.pitch_x_m
    if isnan(width) or isnan(design.thickness_m):
        raise SolverError("the strip needs a pitch and a thickness")
    return HostBeam(float(stack.bending_n_m[1, 1]) * width, stack.mass_kg_m2 * width)


def pillar_filter(design: Design, frequencies_hz: FloatArray, loss: float = 0.0) -> PillarFilter:
    """Scattering of the design's rows, pitch_y apart, at normal incidence. loss: E (1 - i loss) in the pillar.

    The foot stands half a thickness above the neutral line. SolverError without a pillar, a pitch or a thickness.
    """
    if design.pillar is None:
        raise SolverError("a row of pillars needs a pillar")
    host_beam, pillar, lever_m = strip_beam(design), design.pillar, design.thickness_m / 2.0
    omega, rows = 2.0 * pi * frequencies_hz, max(design.rows, 1)
    feet = design_feet(pillar, omega, loss, lever_m)
    scattered = [
        scatter(host_beam, feet, [n * design.pitch_y_m for n in range(count)], omega) for count in range(1, rows + 1)
    ]
    clamped = 2.0 * pi * float(pillar_frequencies_hz(pillar, "timoshenko", about_x=True)[0])
    transmitted = np.stack([np.abs(one.transmission) ** 2 for one in scattered])
    decay = decay_db_per_row(host_beam, feet, design.pitch_y_m, omega)
    lossless = feet if loss == 0.0 else design_feet(pillar, omega, 0.0, lever_m)
    stopping = decay_db_per_row(host_beam, lossless, design.pitch_y_m, omega) > DECAYS_DB
    stopped = moment_total_reflection_rad_s(
        host_beam, lambda w: design_feet(pillar, np.array([w]), 0.0, lever_m), clamped
    )
    return PillarFilter(
        frequencies_hz=frequencies_hz,
        transmitted=transmitted,
        reflected=np.stack([np.abs(one.reflection) ** 2 for one in scattered]),
        decay_db=decay,
        clamped_hz=clamped / (2.0 * pi),
        stopped_hz=stopped / (2.0 * pi),
        oscillator_stopped_hz=oscillator_total_reflection_rad_s(host_beam, pillar.faces * pillar.mass_kg, clamped)
        / (2.0 * pi),
        bands_hz=tuple(half_power_band(one, frequencies_hz) for one in transmitted),
        stop_hz=half_power_band(np.where(stopping, 0.0, 1.0), frequencies_hz),
    )


def design_feet(pillar: Pillar, omega: FloatArray, loss: float = 0.0, lever_m: float = 0.0) -> ComplexArray:
    """Foot stiffness of a design's pillar, or of both on opposite faces, shape (n, 2, 2): diagonal, so that the mirror image
    adds the same.
    """
    axial = pillar.material.rod(2).young_pa * pillar.form.section.area_m2
    return pillar.faces * pillar_foot(pillar_beam(pillar, about_x=True), omega, axial, loss, lever_m)
