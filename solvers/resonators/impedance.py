"""What a structure feels of a resonator standing on it: dynamic stiffness at the foot, time factor e^{-i omega t}.

A stiffness K makes the resonator pull back with force -K w and moment -K theta; losses give K a negative imaginary part.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from geometry.elements import ComplexArray
from solvers.analytic.section import Beam
from solvers.errors import SolverError, checked_frequencies


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
