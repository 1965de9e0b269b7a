"""A pillar on a moving foot: what it carries rigidly and how its own vibrations follow, ready to stand on a plate.

Foot motion d and own modes a_j (foot clamped): T = J d'^2/2 + sum L_j a_j' d' + a_j'^2/2, V = sum omega_j^2 a_j^2/2
(Craig and Bampton, one body). Shear and rotary inertia are Timoshenko's; the section may taper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray
from geometry.layout import Pillar
from solvers.analytic.predesign import pillar_beam
from solvers.analytic.section import Beam

DEGREE = 8  # polynomials of the pillar's own motion: the second mode is then exact to 1e-4
POINTS = 2 * DEGREE + 8
OWN = 2  # modes kept of each kind
ROOT = 16.67 / np.pi


@dataclass(frozen=True)
class EffectiveMass:
    """One motion of the foot: its rigid inertia J, own frequencies omega (n,) in rad/s, couplings L (n,).

    For the foot's rotation J in kg m2 and L in sqrt(kg) m, for its lift in kg and sqrt(kg).
    """

    inertia: float
    omega: FloatArray
    coupling: FloatArray


def root_compliance(pillar: Pillar) -> float:
    """How far a moment turns the pillar's foot in an elastic half-space that holds it, rad/(N m): 16.67/(pi E a^3).

    Plane stress, for a square section of side a; another one has that of the square of equal area. Source: odonnell1960.
    """
    return ROOT / (pillar.material.young_pa * pillar.form.section.area_m2**1.5)


def bending_effective_mass(pillar: Pillar, lever_m: float, compliance: float = 0.0) -> EffectiveMass:
    """The foot turns about a line `lever_m` below it (the plate's middle), the pillar bends. Source: craig1968.

    `compliance` (rad/(N m)) lets the pillar turn on its foot, too: what the plate gives way around it.
    """
    beam = pillar_beam(pillar, about_x=True)
    s, weight, ratio = _rule(beam)
    shapes, slopes = _clamped(s)
    zero, length = np.zeros_like(shapes), beam.length_m
    deflection, turn = np.hstack([shapes, zero]), np.hstack([zero, shapes])
    shear = np.hstack([slopes / length, -shapes])
    bent = np.hstack([zero, slopes / length])
    stiffness = _gram(bent, bent, weight * beam.bending_n_m2 * ratio**4)
    stiffness += _gram(shear, shear, weight * beam.shear_n * ratio**2)
    heavy, rotary = _inertias(beam, weight, ratio)
    if compliance > 0.0:
        deflection, turn = np.column_stack([deflection, length * s]), np.column_stack([turn, np.ones_like(s)])
        stiffness = np.pad(stiffness, (0, 1))
        stiffness[-1, -1] = 1.0 / compliance
    arm = lever_m + length * s
    if beam.end is not None:
        deflection[-1] += beam.end.arm_m * turn[-1]
        arm[-1] += beam.end.arm_m
    mass = _gram(deflection, deflection, heavy) + _gram(turn, turn, rotary)
    inertia = float(heavy @ arm**2 + rotary.sum())
    return _own(stiffness, mass, deflection.T @ (heavy * arm) + turn.T @ rotary, inertia)


def lifting_effective_mass(pillar: Pillar) -> EffectiveMass:
    """The foot moves along the pillar's axis, the pillar stretches."""
    beam = pillar_beam(pillar, about_x=True)
    s, weight, ratio = _rule(beam)
    shapes, slopes = _clamped(s)
    stretch = pillar.material.young_pa * pillar.form.section.area_m2
    heavy, _ = _inertias(beam, weight, ratio)
    stiffness = _gram(slopes / beam.length_m, slopes / beam.length_m, weight * stretch * ratio**2)
    return _own(stiffness, _gram(shapes, shapes, heavy), shapes.T @ heavy, float(heavy.sum()))


def _rule(beam: Beam) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points s in [0, 1], weights in m and section ratios of a Gauss rule along the pillar; last, without weight, its end
    where that carries a body.
    """
    points, weights = legendre.leggauss(POINTS)
    if beam.end is not None:
        points, weights = np.append(points, 1.0), np.append(weights, 0.0)
    s = (points + 1.0) / 2.0
    ratio = np.ones_like(s) if beam.width_ratio is None else beam.width_ratio(s)
    return s, weights * beam.length_m / 2.0, ratio


def _inertias(beam: Beam, weight: FloatArray, ratio: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mass (kg) and rotary inertia (kg m2) at the points of the rule."""
    heavy, rotary = weight * beam.mass_kg_m * ratio**2, weight * beam.rotary_kg_m * ratio**4
    if beam.end is not None:
        heavy[-1], rotary[-1] = beam.end.mass_kg, beam.end.inertia_kg_m2
    return heavy, rotary


def _clamped(s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """s P_k(2 s - 1), zero at the foot, and derivatives over s, (points, DEGREE)."""
    series = np.eye(DEGREE)
    value = legendre.legval(2.0 * s - 1.0, series).T
    slope = 2.0 * legendre.legval(2.0 * s - 1.0, legendre.legder(series)).T
    return np.asarray(s[:, None] * value), np.asarray(value + s[:, None] * slope, dtype=np.float64)


def _gram(left: FloatArray, right: FloatArray, weight: FloatArray) -> FloatArray:
    return np.asarray(left.T @ (weight[:, None] * right))


def _own(stiffness: FloatArray, mass: FloatArray, coupling: FloatArray, inertia: float) -> EffectiveMass:
    values, vectors = eigh(stiffness, mass, subset_by_index=[0, OWN - 1])
    return EffectiveMass(inertia, np.sqrt(values), vectors.T @ coupling)
