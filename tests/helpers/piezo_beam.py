"""Laminated beams with a piezo layer electroded over their whole length: exact frequencies, short and open.

Plane stress in each layer, eps_x = eps_0 - z w'', eps_y alike; no force and no moment across, no force along. Then
M = EI w'' - tau V and q = tau w'' + c V per length: the bending stiffness at constant voltage, the moment of one volt and
the capacitance at constant curvature. A short electrode leaves EI w'''' = m omega^2 w alone; an open one has
V = -tau [w']/(c L) and adds the end moments tau V (erturk2008, whose c takes the beam's axis for unstretched).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, cosh, exp, sin, sinh, tanh

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from geometry.materials import Material, PiezoMaterial
from solvers.analytic.beams import beam_mode, frequency_hz, roots
from solvers.errors import SolverError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Layer:
    """From low_m to high_m (z, m): stiffness (2, 2) of x and y strains in Pa, density, e (2,) in C/m2, permittivity in F/m.

    A layer without electrodes has e = 0 and no permittivity.
    """

    low_m: float
    high_m: float
    stiffness_pa: FloatArray
    density_kg_m3: float
    charge_c_m2: FloatArray
    permittivity_f_m: float


@dataclass(frozen=True)
class Section:
    """EI (N m2) at constant voltage, mass per length (kg/m), tau (N m/V), c (F/m) at constant curvature."""

    bending_n_m2: float
    mass_kg_m: float
    moment_n_m_v: float
    capacitance_f_m: float


def elastic_layer(material: Material, low_m: float, high_m: float) -> Layer:
    """A layer of an isotropic material in plane stress."""
    young, poisson = material.as_isotropic.young_pa, material.as_isotropic.poisson
    stiffness = young / (1.0 - poisson**2) * np.array([[1.0, poisson], [poisson, 1.0]])
    return Layer(low_m, high_m, stiffness, material.density_kg_m3, np.zeros(2), 0.0)


def piezo_layer(material: PiezoMaterial, low_m: float, high_m: float) -> Layer:
    """A layer poled along z and electroded on both faces, free to expand along z. Source: ieee176."""
    charge = material.charge_m_v[2, :2]
    stiffness: FloatArray = np.asarray(np.linalg.inv(material.compliance_pa[:2, :2]), dtype=np.float64)
    stress = stiffness @ charge
    permittivity = float(material.permittivity_free_f_m[2, 2] - charge @ stress)
    return Layer(low_m, high_m, stiffness, material.density_kg_m3, stress, permittivity)


def laminate(layers: Sequence[Layer], width_m: float, stretch: bool = True, uneven: bool = False) -> Section:
    """Section of bonded layers under one voltage V across each piezo layer, the field being -V over its thickness.

    stretch: whether the voltage also stretches the beam (it does; erturk2008 leaves that out of c). uneven: whether the field
    may be uneven across a layer (it is; erturk2008 leaves that out, too): what is odd about its middle meets D = 0 and
    e e'/permittivity more stiffness. SolverError when no layer is piezoelectric.
    """
    whole, force, capacitance, mass = np.zeros((4, 4)), np.zeros(4), 0.0, 0.0
    for layer in layers:
        first, second, third = ((layer.high_m**n - layer.low_m**n) / n for n in (1, 2, 3))
        mass += width_m * layer.density_kg_m3 * first
        whole += width_m * np.kron(np.array([[first, -second], [-second, third]]), layer.stiffness_pa)
        if layer.permittivity_f_m:
            force -= width_m * np.kron([1.0, -second / first], layer.charge_c_m2)
            capacitance += width_m * layer.permittivity_f_m / first
        if layer.permittivity_f_m and uneven:
            stiffer = np.outer(layer.charge_c_m2, layer.charge_c_m2) / layer.permittivity_f_m
            whole += width_m * np.kron(np.diag([0.0, third - second**2 / first]), stiffer)
    if not capacitance:
        raise SolverError("no layer is piezoelectric: nothing couples the beam to a circuit")
    free = [0, 1, 3]  # stretch along and across, curvature across; 2 is the curvature w''
    follow = np.linalg.solve(whole[np.ix_(free, free)], np.column_stack([whole[free, 2], force[free]]))
    return Section(
        float(whole[2, 2] - whole[2, free] @ follow[:, 0]),
        mass,
        float(force[2] - whole[2, free] @ follow[:, 1]),
        float(capacitance + (force[free] @ follow[:, 1] if stretch else 0.0)),
    )


def cantilever_hz(section: Section, length_m: float, number: int, is_open: bool) -> float:
    """Mode `number` (from 1) of a beam clamped at x = 0.

    EI k (1 + cos k cosh k) + (tau^2/c) (cosh k sin k + cos k sinh k) = 0 over L, k = beta L; short: tau = 0.
    """
    kappa = roots("clamped", "free", number + 1)
    if is_open:
        return _hz(section, length_m, _open_root(section, _clamped, kappa[number - 1], kappa[number]))
    return _hz(section, length_m, kappa[number - 1])


def free_even_hz(section: Section, length_m: float, number: int, is_open: bool) -> float:
    """Even mode `number` (from 1) of a beam free at both ends, h = k/2: odd ones have [w'] = 0 and ignore the circuit.

    EI k (tan h + tanh h) + 4 (tau^2/c) tan h tanh h = 0, times cos h; short: tau = 0.
    """
    kappa = roots("free", "free", 2 * number + 1)[::2]
    if is_open:
        return _hz(section, length_m, _open_root(section, _free, kappa[number - 1], kappa[number]))
    return _hz(section, length_m, kappa[number - 1])


def _hz(section: Section, length_m: float, kappa: float) -> float:
    return frequency_hz(kappa, length_m, section.bending_n_m2, section.mass_kg_m)


def _clamped(k: float, share: float) -> float:
    """Scaled by exp(-k) against overflow."""
    return exp(-k) * (k * (1.0 + cos(k) * cosh(k)) + share * (cosh(k) * sin(k) + cos(k) * sinh(k)))


def _free(k: float, share: float) -> float:
    h = k / 2.0
    return k * (sin(h) + tanh(h) * cos(h)) + 4.0 * share * sin(h) * tanh(h)


def _open_root(section: Section, equation: Callable[[float, float], float], low: float, high: float) -> float:
    """The open mode between two consecutive short ones: a free voltage removes one constraint."""
    share = section.moment_n_m_v**2 / (section.capacitance_f_m * section.bending_n_m2)
    hair = 1e-9 * (high - low)  # below the short root, where a coupling lost in rounding leaves the open one
    return float(brentq(equation, low - hair, high - hair, args=(share,), xtol=1e-13))


def gain_per_volt(section: Section, length_m: float, number: int) -> float:
    """phi' theta = tau [phi'] of the even free mode `number`, of unit modal mass and above 0 at the ends, N/(V sqrt(kg)).

    phi is (m L)^-1/2 times the beam function with mean square 1.
    """
    mode = beam_mode("free", "free", 2 * number - 1)
    slope = float(mode.shape(1.0, 1) - mode.shape(0.0, 1)) / length_m
    return section.moment_n_m_v * slope / float(np.sqrt(section.mass_kg_m * length_m))
