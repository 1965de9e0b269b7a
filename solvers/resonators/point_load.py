"""A flexural wave on an endless beam met by one point force or moment: total reflection and what falls short of it; e^{-iwt}.

Everything in units of the incident amplitude and of the wavelength; the beam's data drop out.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.resonators.scattering import HostBeam, field, scatter

PINNED = 1e9  # s that stands for infinity: |t|^2 = 1/2 to a billionth
SPAN = 2.0  # wavelengths shown on each side


@dataclass(frozen=True)
class ScatteringCase:
    """One resonator: deflection phasor (n,) along the beam, shares of power transmitted, reflected and absorbed."""

    name: str
    deflection: ComplexArray
    transmitted: float
    reflected: float
    absorbed: float


@dataclass(frozen=True)
class PointForce:
    """x over the wavelength (n,), and what a unit wave from the left becomes at each kind of point."""

    x_over_wavelength: FloatArray
    cases: tuple[ScatteringCase, ...]

    def of(self, name: str) -> ScatteringCase:
        """The case of a name. SolverError without one."""
        for case in self.cases:
            if case.name == name:
                return case
        raise SolverError(f"no case {name!r}: there are {', '.join(case.name for case in self.cases)}")

    def to_dict(self) -> dict[str, Any]:
        """A plain document: amplitudes and powers in shares of the incident ones."""
        return {
            "x_over_wavelength": self.x_over_wavelength.tolist(),
            "cases": [
                {
                    "name": case.name,
                    "transmitted": case.transmitted,
                    "reflected": case.reflected,
                    "absorbed": case.absorbed,
                    "abs": np.abs(case.deflection).tolist(),
                }
                for case in self.cases
            ],
        }


def point_force(points: int = 801) -> PointForce:
    """Spring s = 1, pinned point, damper of the printed condition s = -i, moment s = -1, and the printed force by itself.

    s = K_ww/(4 EI beta^3) of a force -K w(0), or K_tt/(4 EI beta) of a moment -K w'(0). Total reflection takes the force
    +4 i EI beta^3 W_p, which the spring's is; the printed -4 i EI beta^3 W_p doubles the wave instead. SolverError for
    fewer than two points.
    """
    if points < 2:
        raise SolverError(f"points = {points}: must be 2 or more")
    x = np.linspace(-SPAN, SPAN, points)
    cases = [_scattering_case(name, s, axis, x) for name, s, axis in KINDS]
    beta_x = 2.0 * pi * x
    green = (1j * np.exp(1j * np.abs(beta_x)) - np.exp(-np.abs(beta_x))) / 4.0
    force = -4j  # over EI beta^3 W_p
    back = 1j * force / 4.0
    there = 1.0 + back
    powers = abs(there) ** 2, abs(back) ** 2
    driven = ScatteringCase("printed force", np.exp(1j * beta_x) + force * green, *powers, 1.0 - sum(powers))
    return PointForce(x, (*cases, driven))


KINDS = (("spring", 1.0, 0), ("pinned", PINNED, 0), ("printed damper", -1j, 0), ("moment", -1.0, 1))


def _scattering_case(name: str, strength: complex, axis: int, x: FloatArray) -> ScatteringCase:
    host_beam, omega = HostBeam(1.0, 1.0), np.array([4.0 * pi**2])  # beta = 2 pi: lengths in wavelengths
    beta = float(host_beam.wavenumber_per_m(omega)[0])
    foot = np.zeros((1, 2, 2), dtype=complex)
    foot[0, axis, axis] = 4.0 * strength * beta ** (3 - 2 * axis)
    scattered = scatter(host_beam, foot, [0.0], omega)
    return ScatteringCase(
        name,
        field(host_beam, scattered, [0.0], omega, x)[0],
        float(abs(scattered.transmission[0]) ** 2),
        float(abs(scattered.reflection[0]) ** 2),
        float(scattered.absorbed[0]),
    )
