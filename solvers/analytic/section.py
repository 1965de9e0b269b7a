"""A beam's section as Timoshenko's theory takes it: its stiffnesses and inertias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np

from geometry.elements import FloatArray
from solvers.errors import SolverError, check_above_zero


@dataclass(frozen=True)
class EndBody:
    """A rigid body on a beam's end: mass, rotary inertia about its own centre, how far that lies beyond the end. SI."""

    mass_kg: float
    inertia_kg_m2: float
    arm_m: float


@dataclass(frozen=True)
class Beam:
    """A beam in bending, SI. width_ratio(s), s = x/L, scales every section size against the one at s = 0; `end` is carried
    at s = 1.

    length_m L; bending_n_m2 EI, shear_n kappa G A, mass_kg_m rho A, rotary_kg_m rho I, all at s = 0.
    """

    length_m: float
    bending_n_m2: float
    shear_n: float
    mass_kg_m: float
    rotary_kg_m: float
    width_ratio: Callable[[FloatArray], FloatArray] | None = None
    end: EndBody | None = None

    @property
    def flexibility(self) -> float:
        """E I/(kappa G A L^2), dimensionless: 0 is Euler-Bernoulli's beam."""
        return self.bending_n_m2 / (self.shear_n * self.length_m**2)

    @property
    def rotation(self) -> float:
        """I/(A L^2), dimensionless: rotary inertia."""
        return self.rotary_kg_m / (self.mass_kg_m * self.length_m**2)

    @property
    def end_shares(self) -> tuple[float, float, float]:
        """The end body's mass over rho A L, its inertia over rho A L^3 and its arm over L; zeros without one."""
        if self.end is None:
            return 0.0, 0.0, 0.0
        mass = self.mass_kg_m * self.length_m
        return self.end.mass_kg / mass, self.end.inertia_kg_m2 / mass / self.length_m**2, self.end.arm_m / self.length_m

    @property
    def unit_rad_s(self) -> float:
        """sqrt(EI/(rho A L^4)), rad/s: omega over this is the dimensionless frequency."""
        return sqrt(self.bending_n_m2 / self.mass_kg_m) / self.length_m**2


def beam_of(
    length_m: float, area_m2: float, about_m4: float, shear_factor: float, material: tuple[float, float, float]
) -> Beam:
    """A uniform beam from its section's area, second moment and shear factor, and (E, density, nu) in SI.

    Raises SolverError for a size or constant that is not above 0.
    """
    young, density, poisson = material
    for what, value in (("length", length_m), ("section", min(area_m2, about_m4)), ("E", young), ("density", density)):
        check_above_zero(f"beam {what}", value)
    shear = shear_factor * young / (2.0 * (1.0 + poisson)) * area_m2
    return Beam(length_m, young * about_m4, shear, density * area_m2, density * about_m4)


def check_beam(beam: Beam, count: int) -> None:
    """SolverError unless every size is finite and above 0 and at least one mode is asked."""
    sizes = (beam.length_m, beam.bending_n_m2, beam.shear_n, beam.mass_kg_m, beam.rotary_kg_m)
    if count < 1 or not all(np.isfinite(size) and size > 0.0 for size in sizes):
        raise SolverError(f"beam {sizes}, count {count}: every number must be finite and above 0")
