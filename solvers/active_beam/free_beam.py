"""A free-free Euler-Bernoulli beam answering point forces: exact waves at any complex frequency, and modes; e^{st}.

Losses are Kelvin and Voigt's, E (1 + s theta), so that waves, modes and time stepping speak of one beam.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import Material
from solvers.analytic.beams import free_free_mode
from solvers.errors import SolverError, checked_frequencies

ASYMPTOTIC = 20  # number of shapes whose wavenumbers are solved for
UNBOUNDED = 1e9  # receptances this many times 1/(4 EI |beta|^3) are a resonance met to nine digits
EXACTLY = "a lossless resonance is hit exactly: give the beam a loss or move the frequency"


@dataclass(frozen=True)
class FreeBeam:
    """length_m L, bending_n_m2 EI, mass_kg_m rho A, viscosity_s theta of E (1 + s theta): loss factor omega theta."""

    length_m: float
    bending_n_m2: float
    mass_kg_m: float
    viscosity_s: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.length_m, self.bending_n_m2, self.mass_kg_m)
        if not all(isfinite(size) and size > 0.0 for size in sizes) or not 0.0 <= self.viscosity_s < inf:
            raise SolverError(f"{self}: sizes must be finite and above 0, the viscosity 0 or more")

    def wavenumber_per_m(self, omega: ArrayLike) -> FloatArray:
        """beta = (rho A omega^2/EI)^(1/4) without losses, rad/m, shape of omega."""
        return np.asarray((self.mass_kg_m * checked_frequencies(omega) ** 2 / self.bending_n_m2) ** 0.25)

    def point_stiffness_n_m(self, omega: float) -> float:
        """4 EI beta^3, N/m: what an endless beam opposes to a point force, up to a factor of modulus sqrt(2)."""
        return float(4.0 * self.bending_n_m2 * self.wavenumber_per_m(omega) ** 3)

    def natural_rad_s(self, modes: int) -> FloatArray:
        """Natural frequencies of the first `modes` shapes, the two rigid ones included, rad/s, ascending."""
        kappas = (np.arange(modes) - 0.5) * pi  # 1/cosh(kappa) off, nothing in double precision from ASYMPTOTIC on
        kappas[:ASYMPTOTIC] = [free_free_mode(nodes).kappa for nodes in range(min(modes, ASYMPTOTIC))]
        return np.asarray(kappas**2 / self.length_m**2 * sqrt(self.bending_n_m2 / self.mass_kg_m))

    def shapes(self, x_m: ArrayLike, modes: int) -> FloatArray:
        """Shapes with mean square 1 (modal mass rho A L), shape (points, modes)."""
        s = self._inside(x_m) / self.length_m
        return np.stack([free_free_mode(nodes).shape(s) for nodes in range(modes)], axis=1)

    def receptance(self, x_m: ArrayLike, source_m: ArrayLike, s: ArrayLike) -> ComplexArray:
        """Deflection at x of a unit force at `source`, exact, shape (*s.shape, points, sources), m/N.

        EI (1 + s theta) w'''' + rho A s^2 w = delta(x - source), w'' = w''' = 0 at both ends. With p the two fourth roots
        of -rho A s^2/(EI (1 + s theta)) in the left half plane: w = sum of e^{p|x - source|}/(4 EI (1 + s theta) p^3) plus
        what the ends send back, e^{p x} and e^{p (L - x)}; nothing overflows. SolverError for s = 0, for places off the
        beam, at a lossless resonance. Source: graff1975.
        """
        x, sources, at = self._inside(x_m), self._inside(source_m), np.asarray(s, dtype=complex)
        stiff = self.bending_n_m2 * (1.0 + self.viscosity_s * at)
        if np.any(at == 0.0) or np.any(stiff == 0.0) or not np.all(np.isfinite(at)):
            raise SolverError("frequencies must be finite and other than 0")
        roots = self._decaying(at)[..., None, :]  # one for all places
        size = np.abs(roots[..., 0])
        ends = [(np.array([end]), side, n) for end, side in ((0.0, -1.0), (self.length_m, 1.0)) for n in (2, 3)]
        matrix = np.concatenate([self._waves(roots, end, n) / size[..., None] ** n for end, _, n in ends], axis=-2)
        sent = np.stack([side**n * _direct(roots, end - sources, n) / size**n for end, side, n in ends], axis=-2)
        try:
            echoes = np.linalg.solve(matrix, -sent)
        except np.linalg.LinAlgError:
            raise SolverError(EXACTLY) from None
        distances = x[:, None] - sources[None, :]
        response = _direct(roots[..., None, :], distances, 0) + self._waves(roots, x, 0) @ echoes
        _check_bounded(response, size[..., None], at)
        return np.asarray(response / stiff[..., None, None])

    def _decaying(self, s: ComplexArray) -> ComplexArray:
        """The two roots that decay to the right, last axis 2."""
        fourth = -self.mass_kg_m * s**2 / (self.bending_n_m2 * (1.0 + self.viscosity_s * s))
        four = (fourth**0.25)[..., None] * np.array([1.0, -1.0, 1.0j, -1.0j])
        order = np.argsort(four.real, axis=-1, kind="stable")[..., :2]
        return np.asarray(np.take_along_axis(four, order, axis=-1))

    def _waves(self, roots: ComplexArray, x: FloatArray, derivative: int) -> ComplexArray:
        """Derivatives of e^{p x} and e^{p (L - x)} at every x, shape (..., points, 4)."""
        left = roots**derivative * np.exp(roots * x[:, None])
        right = (-roots) ** derivative * np.exp(roots * (self.length_m - x[:, None]))
        return np.concatenate([left, right], axis=-1)

    def _inside(self, x_m: ArrayLike) -> FloatArray:
        x = np.atleast_1d(np.asarray(x_m, dtype=float))
        if not np.all((x >= 0.0) & (x <= self.length_m)):
            raise SolverError(f"places must lie on the beam, 0 to {self.length_m:g} m")
        return x


def strip(
    length_m: float, width_m: float, thickness_m: float, material: Material, viscosity_s: float = 0.0
) -> FreeBeam:
    """A flat strip: EI = E b h^3/12, rho A = rho b h."""
    bending = material.young_pa * width_m * thickness_m**3 / 12.0
    return FreeBeam(length_m, bending, material.density_kg_m3 * width_m * thickness_m, viscosity_s)


def antinodes_m(beam: FreeBeam, source_m: float, omega: float, steps: int = 4000) -> FloatArray:
    """Local maxima of |w| inside the beam under a force at `source`, m, to a step of L/steps."""
    x = np.linspace(0.0, beam.length_m, steps + 1)
    size = np.abs(beam.receptance(x, source_m, 1j * float(checked_frequencies(omega)))[:, 0])
    inner = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])
    return np.asarray(x[1:-1][inner])


def _direct(roots: ComplexArray, distance: FloatArray, derivative: int) -> ComplexArray:
    """Derivatives outwards of sum e^{p|d|}/(4 p^3), the shape of distance."""
    d = np.abs(np.asarray(distance))[..., None]
    return np.asarray(np.sum(roots**derivative * np.exp(roots * d) / (4.0 * roots**3), axis=-1))


def _check_bounded(response: ComplexArray, size: FloatArray, s: ComplexArray) -> None:
    """SolverError when an answer is rounding noise over the zero of a lossless resonance."""
    peaks = np.ravel(np.max(np.abs(response) * size**3, axis=(-2, -1), initial=0.0))
    if not np.all(peaks <= UNBOUNDED / 4.0):
        worst = abs(np.ravel(s)[int(np.argmax(np.nan_to_num(peaks, nan=np.inf)))])
        raise SolverError(f"{EXACTLY} (near {worst / (2.0 * pi):.9g} Hz)")
