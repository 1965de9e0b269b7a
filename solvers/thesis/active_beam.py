"""Velocity feedback at points of a free-free beam: waves, modes, motion, stability, and active pillars that confine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise, permutations
from math import inf, isfinite, isinf, isnan, nan, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.signal import argrelmax

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import MATERIALS, Material
from solvers.analytic.beams import free_free_mode
from solvers.errors import SolverError, check_bounded, checked_frequencies, solved

ASYMPTOTIC = 20  # number of shapes whose wavenumbers are solved for
Filter = Callable[[FloatArray], ComplexArray]
HIGHEST_HZ = 1e12
MODES = 40  # of the pole calculation: 1e-3 of the whole beam's poles

STEPS = 1500  # of x


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
        """4 EI beta^3, N/m: point stiffness of an infinite beam, up to a factor of modulus sqrt(2)."""
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
        the reflections at the ends, e^{p x} and e^{p (L - x)}; nothing overflows. SolverError for s = 0, for places off the
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
        echoes = solved(matrix, -sent)
        distances = x[:, None] - sources[None, :]
        response = _direct(roots[..., None, :], distances, 0) + self._waves(roots, x, 0) @ echoes
        peaks = 4.0 * np.max(np.abs(response), axis=(-2, -1), initial=0.0) * size[..., 0] ** 3
        check_bounded(np.ravel(peaks), np.abs(np.ravel(at)))
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


@dataclass(frozen=True, eq=False)
class Layout:
    """Points where loops act and measure: points_m (p,), spread (p, loops) of a loop's signal over the points, pick (loops, p).

    Dual when pick is spread transposed: every loop then takes power out at any gain.
    """

    name: str
    points_m: FloatArray
    spread: FloatArray
    pick: FloatArray

    @property
    def dual(self) -> bool:
        """True if a loop senses the motion that its forces do work on."""
        return bool(np.array_equal(self.pick, self.spread.T))

    @property
    def region_m(self) -> tuple[float, float]:
        """Outermost points, m: the stretch that the loops shall confine to."""
        return float(self.points_m.min()), float(self.points_m.max())


@dataclass(frozen=True)
class ForcedBeam:
    """Steady state: deflection phasors at x (n,) and point forces (p,), per newton of excitation."""

    deflection: ComplexArray
    forces: ComplexArray


@dataclass(frozen=True)
class Confinement:
    """Amplitudes over a region and beyond it, m/N: largest and root mean square; ratio of the two rms values."""

    inside_max: float
    outside_max: float
    inside_rms: float
    outside_rms: float

    @property
    def ratio(self) -> float:
        """rms inside over rms outside."""
        return self.inside_rms / self.outside_rms


@dataclass(frozen=True)
class Loci:
    """Eigenvalues of the return ratio per unit damper over n frequencies, (n, loops), followed from one to the next.

    omega_rad_s (n,) from the carrier's neighbourhood to the upper end. Gain and delay are common to all loops, so that
    these eigenvalues' distance from -1 gives their margins exactly.
    """

    omega_rad_s: FloatArray
    values: ComplexArray


@dataclass(frozen=True)
class ActiveBeamData:
    """The thesis states no beam; ours is the steel strip of its later experiments, free at both ends, driven in its middle.

    Lengths m, frequencies Hz, gains K' N/m, force N. apart_m: two points of a pair, one patch apart. quality_factor:
    1/(omega theta) at the first frequency, inf without losses. delays_s: one sample at 250 and at 40 kHz. left_m: middle of
    the loops on the left; None takes the antinode nearest to a quarter of the length at the first frequency.
    """

    length_m: float = 0.150
    width_m: float = 0.020
    thickness_m: float = 1e-3
    material: Material = MATERIALS["steel"]
    frequencies_hz: tuple[float, ...] = (3000.0, 5000.0)
    gains_n_m: tuple[float, ...] = (1e7, 1e8)
    force_n: float = 1.0
    apart_m: float = 0.012
    quality_factor: float = 300.0
    left_m: float | None = None
    delays_s: tuple[float, ...] = (4e-6, 25e-6)

    @property
    def beam(self) -> FreeBeam:
        """The strip with its losses."""
        viscosity = (
            0.0 if isinf(self.quality_factor) else 1.0 / (self.quality_factor * 2.0 * pi * self.frequencies_hz[0])
        )
        return strip(self.length_m, self.width_m, self.thickness_m, self.material, viscosity)

    @property
    def place_m(self) -> float:
        """Middle of the left loops, m."""
        if self.left_m is not None:
            return self.left_m
        antinodes = antinodes_m(self.beam, self.length_m / 2.0, 2.0 * pi * self.frequencies_hz[0])
        room = (antinodes > self.apart_m) & (antinodes < self.length_m / 2.0 - self.apart_m)
        if not room.any():
            raise SolverError("no antinode lies between an end and the middle of the beam: state where the loops stand")
        return float(antinodes[room][np.argmin(np.abs(antinodes[room] - self.length_m / 4.0))])


@dataclass(frozen=True)
class Case:
    """One layout at one frequency and gain: strength K'/(4 EI beta^3), the steady state, amplitudes without and with loops.

    largest_force_n: of a point in the steady state; switch_on_force_n: K' times the largest loop signal before the loops close.
    """

    layout: str
    frequency_hz: float
    gain_n_m: float
    strength: float
    steady: ForcedBeam
    before: Confinement
    after: Confinement
    largest_force_n: float
    switch_on_force_n: float

    @property
    def outside_reduced_by(self) -> float:
        """rms beyond the loops, without over with them."""
        return self.before.outside_rms / self.after.outside_rms


@dataclass(frozen=True)
class LoopStability:
    """One layout: growth of the slowest pole at each gain, 1/s (above 0 unstable); the gain K' that makes a pole grow.

    delay_margin_s at each gain, None where the loop is unstable without delay; gain_limits K' for each delay of the data,
    for demodulation over one period as the last. Hz: the frequency that sets each.
    """

    layout: str
    dual: bool
    growth_per_s: tuple[float, ...]
    unstable_from_n_m: float
    delay_margin_s: tuple[float | None, ...]
    gain_limits_n_m: tuple[float, ...]
    gain_limits_hz: tuple[float, ...]


@dataclass(frozen=True)
class ActiveBeamStudy:
    """Figures 3.5 to 3.8 computed, with results that they omit: forces, stability, sensitivity to gain and place.

    open_m (frequencies, n): |w| without loops at x_m; sweeps hold rms inside over rms outside per layout.
    """

    data: ActiveBeamData
    left_m: float
    x_m: FloatArray
    open_m: FloatArray
    cases: tuple[Case, ...]
    stability: tuple[LoopStability, ...]
    sweep_gains_n_m: FloatArray
    gain_sweep: dict[str, FloatArray]
    sweep_places_m: FloatArray
    place_sweep: dict[str, FloatArray] = field(repr=False)

    def case(self, layout: str, frequency_hz: float, gain_n_m: float) -> Case:
        """The case of these three. SolverError when it was not computed."""
        for one in self.cases:
            if (one.layout, one.frequency_hz, one.gain_n_m) == (layout, frequency_hz, gain_n_m):
                return one
        raise SolverError(f"no case {layout} at {frequency_hz:g} Hz and K' = {gain_n_m:g} N/m")

    def to_dict(self) -> dict[str, Any]:
        """Beam, places, stability and sweeps in SI."""
        data, beam = self.data, self.data.beam
        kept = ("length_m", "width_m", "thickness_m", "apart_m", "force_n", "quality_factor")
        return {
            "beam": {
                **{key: getattr(data, key) for key in kept},
                "material": data.material.name,
                "bending_n_m2": beam.bending_n_m2,
                "mass_kg_m": beam.mass_kg_m,
                "left_m": self.left_m,
                "natural_hz": beam.natural_rad_s(9)[2:] / (2.0 * pi),
            },
            "point_stiffness_n_m": [beam.point_stiffness_n_m(2.0 * pi * f) for f in data.frequencies_hz],
            # where beta h = 1: beyond it shear and rotary inertia count and the beam's theory does not hold
            "thin_beam_limit_hz": (beam.bending_n_m2 / beam.mass_kg_m) ** 0.5 / data.thickness_m**2 / (2.0 * pi),
            **{key: getattr(data, key) for key in ("frequencies_hz", "gains_n_m", "delays_s")},
            "stability": self.stability,
            "gain_sweep": {"gains_n_m": self.sweep_gains_n_m, **self.gain_sweep},
            "place_sweep": {"places_m": self.sweep_places_m, **self.place_sweep},
        }


def strip(
    length_m: float, width_m: float, thickness_m: float, material: Material, viscosity_s: float = 0.0
) -> FreeBeam:
    """Return the beam of a flat strip: EI = E b h^3/12, rho A = rho b h.

    Parameters
    ----------
    length_m, width_m, thickness_m : float
        Length L, width b and thickness h.
    material : Material
        Modulus along the strip and density.
    viscosity_s : float, optional
        theta of the modulus E (1 + s theta).

    Returns
    -------
    FreeBeam
        The strip, free at both ends.
    """
    bending = material.rod(0).young_pa * width_m * thickness_m**3 / 12.0
    return FreeBeam(length_m, bending, material.density_kg_m3 * width_m * thickness_m, viscosity_s)


def antinodes_m(beam: FreeBeam, source_m: float, omega: float, steps: int = 4000) -> FloatArray:
    """Find the local maxima of |w| along the beam under a force.

    Parameters
    ----------
    beam : FreeBeam
        The beam, without loops.
    source_m : float
        Place of the force.
    omega : float
        Angular frequency in rad/s.
    steps : int, optional
        Intervals along the beam, which bound the error of an antinode.

    Returns
    -------
    ndarray, shape (n,)
        Places in m, ascending, without the ends.
    """
    x = np.linspace(0.0, beam.length_m, steps + 1)
    size = np.abs(beam.receptance(x, source_m, 1j * float(checked_frequencies(omega)))[:, 0])
    return np.asarray(x[argrelmax(size)])


def loop_layouts(left_m: float, apart_m: float, length_m: float) -> tuple[Layout, ...]:
    """Return the study's layouts: loops about a place and, mirrored, on the other side.

    point: one point on each side with its own velocity. pair: two, each with its own. couple: two pulled by opposed
    forces of their relative velocity, a couple. opposed: two, each with its own, the inner ones with the sign turned
    over: not dual.

    Parameters
    ----------
    left_m : float
        Middle of the loops on the left.
    apart_m : float
        Distance between the two points of a side, in all layouts but the first.
    length_m : float
        Length of the beam.

    Returns
    -------
    tuple of Layout
        point, pair, couple, opposed.
    """
    two, half = np.array([left_m, length_m - left_m]), apart_m / 2.0 * np.array([-1.0, 1.0])
    four, relative = (two[:, None] + half).ravel(), np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]])
    return (
        Layout("point", two, np.eye(2), np.eye(2)),
        Layout("pair", four, np.eye(4), np.eye(4)),
        Layout("couple", four, relative.T, relative),
        Layout("opposed", four, np.diag([1.0, -1.0, -1.0, 1.0]), np.eye(4)),
    )


def forced(
    beam: FreeBeam, layout: Layout, gain_n_m: complex, omega: float, x_m: FloatArray, source_m: float
) -> ForcedBeam:
    """Compute the beam under 1 N with the loops closed: f = -(I + H C G B)^-1 H C g, H = j K'.

    Parameters
    ----------
    beam : FreeBeam
        The beam.
    layout : Layout
        Points of the loops, B (spread) and C (pick).
    gain_n_m : complex
        K' in N/m, 0 for open loops; complex where the loops answer late: K' e^{-j omega delay}.
    omega : float
        Angular frequency in rad/s.
    x_m : ndarray, shape (n,)
        Places of the deflection.
    source_m : float
        Place of the excitation.

    Returns
    -------
    ForcedBeam
        Deflection (n,) in m/N and forces of the loops (p,) in N/N.

    Raises
    ------
    SolverError
        If the gain is not finite, the frequency not above 0 or of a lossless resonance, or the loop singular.
    """
    if not np.isfinite(gain_n_m):
        raise SolverError(f"gain K' = {gain_n_m:g} N/m: must be finite")
    s, sources = 1j * float(checked_frequencies(omega)), np.append(layout.points_m, source_m)
    heard = 1j * gain_n_m * layout.pick @ beam.receptance(layout.points_m, sources, s)
    forces = layout.spread @ solved(np.eye(len(heard)) + heard[:, :-1] @ layout.spread, -heard[:, -1])
    return ForcedBeam(beam.receptance(x_m, sources, s) @ np.append(forces, 1.0), forces)


def confinement(x_m: FloatArray, deflection: ComplexArray, region_m: tuple[float, float]) -> Confinement:
    """Compare the amplitudes within a region with those beyond it.

    Parameters
    ----------
    x_m : ndarray, shape (n,)
        Places, evenly spaced.
    deflection : ndarray, shape (n,)
        Complex amplitudes there.
    region_m : tuple of float
        Ends of the region, in m.

    Returns
    -------
    Confinement
        Largest and rms amplitudes of both parts, in the unit of the deflection.

    Raises
    ------
    SolverError
        If one of the parts holds no point.
    """
    inside = (x_m > region_m[0]) & (x_m < region_m[1])
    size = np.abs(deflection)
    if not inside.any() or inside.all():
        raise SolverError("the region to confine to must hold some of the beam and leave some of it out")
    rms = [float(np.sqrt(np.mean(size[part] ** 2))) for part in (inside, ~inside)]
    return Confinement(float(size[inside].max()), float(size[~inside].max()), *rms)


def closed_loop_poles(beam: FreeBeam, layout: Layout, damper_n_s_m: float, modes: int = MODES) -> ComplexArray:
    """Compute the poles of the first modes under f = -c C w', without delay.

    q'' + (theta Omega^2 + c P' B C P/m) q' + Omega^2 q = 0 with P the shapes at the points and m = rho A L.

    Parameters
    ----------
    beam : FreeBeam
        The beam.
    layout : Layout
        Points of the loops, B and C.
    damper_n_s_m : float
        Damper c in N s/m.
    modes : int, optional
        Number of modes, the two rigid ones included.

    Returns
    -------
    ndarray, shape (2 modes,)
        Complex poles in 1/s, unordered.
    """
    shapes, square = beam.shapes(layout.points_m, modes), beam.natural_rad_s(modes) ** 2
    feedback = shapes.T @ layout.spread @ layout.pick @ shapes
    damping = np.diag(beam.viscosity_s * square) + damper_n_s_m / (beam.mass_kg_m * beam.length_m) * feedback
    unit = float(np.sqrt(square[-1])) or 1.0  # one size for displacement and velocity
    state = np.block([[np.zeros((modes, modes)), np.eye(modes)], [-np.diag(square) / unit**2, -damping / unit]])
    return np.asarray(np.linalg.eigvals(state) * unit)


def growth_per_s(beam: FreeBeam, layout: Layout, damper_n_s_m: float) -> float:
    """Return the largest real part of the poles other than rigid drift.

    Parameters
    ----------
    beam : FreeBeam
        The beam.
    layout : Layout
        Points of the loops.
    damper_n_s_m : float
        Damper c in N s/m.

    Returns
    -------
    float
        Growth in 1/s; above 0 is unstable.
    """
    poles = closed_loop_poles(beam, layout, damper_n_s_m)
    return float(poles[np.abs(poles) > 1e-3 * beam.natural_rad_s(3)[2]].real.max())


def characteristic_loci(beam: FreeBeam, layout: Layout, high_hz: float) -> Loci:
    """Compute the eigenvalues of j omega C G(j omega) B on a grid that resolves every resonance from 1 Hz upwards.

    Parameters
    ----------
    beam : FreeBeam
        The beam, with losses: the grid contains its natural frequencies.
    layout : Layout
        Points of the loops, B and C.
    high_hz : float
        Upper end of the frequencies.

    Returns
    -------
    Loci
        Eigenvalues in m/(N s), each column continuous in frequency.
    """
    omega = _grid(beam, 2.0 * pi, 2.0 * pi * high_hz)
    values = np.asarray(np.linalg.eigvals(_return_ratio(beam, layout, omega)), dtype=complex)
    # each frequency's eigenvalues in the order that moves them least from those before
    orders = [list(order) for order in permutations(range(values.shape[1]))]
    for i in range(1, len(values)):
        candidates = values[i][np.array(orders)]
        values[i] = candidates[np.argmin(np.sum(np.abs(candidates - values[i - 1]), axis=1))]
    return Loci(omega, values)


def _highest_hz(beam: FreeBeam, layout: Layout, damper_n_s_m: float) -> float:
    """A frequency, Hz, above which no loop of this damper has a gain of 1: |lambda| falls at least as omega^-1/2."""
    high = 1e5
    while high < HIGHEST_HZ:
        ratio = _return_ratio(beam, layout, np.array([2.0 * pi * high]))
        if damper_n_s_m * np.abs(np.linalg.eigvals(ratio)).max() < 0.5:
            break
        high *= 2.0
    return high


def delay_margin_s(loci: Loci, damper_n_s_m: float) -> float:
    """Compute the largest pure delay that the loop bears: the least phase above -pi over omega where |c lambda| = 1.

    Parameters
    ----------
    loci : Loci
        Characteristic loci per unit damper.
    damper_n_s_m : float
        Damper c in N s/m, at which the loop is stable without delay.

    Returns
    -------
    float
        Delay in s; inf without a crossing.

    Raises
    ------
    SolverError
        If the loop gain exceeds 1 at the upper end of the frequencies.
    """
    size = damper_n_s_m * np.abs(loci.values)
    if np.any(size[-1] > 1.0):
        raise SolverError("the loop gain is above 1 at the upper end of the frequencies: widen them")
    value, omega = _crossings(loci, np.log(size), loci.values)
    return float(np.min((np.angle(value) + pi) % (2.0 * pi) / omega, initial=inf))


def gain_limit_n_s_m(loci: Loci, filtered: Filter) -> tuple[float, float]:
    """Compute the largest damper c that a law c H(omega) bears.

    The least 1/|lambda H| where lambda H crosses the negative real axis: valid for a plant that is stable by itself.

    Parameters
    ----------
    loci : Loci
        Characteristic loci per unit damper.
    filtered : callable
        H (n,) of angular frequencies (n,) in rad/s.

    Returns
    -------
    damper_n_s_m : float
        Largest stable c in N s/m; inf without a crossing.
    frequency_hz : float
        Frequency of the instability; NaN without one.
    """
    values = loci.values * filtered(loci.omega_rad_s)[:, None]
    found, omega = _crossings(loci, values.imag, values)
    limits = [(float(-1.0 / x), float(w / (2.0 * pi))) for x, w in zip(found.real, omega, strict=True) if x < 0.0]
    return min(limits, default=(inf, nan))


def delayed(delay_s: float) -> Filter:
    """Return the filter of a velocity loop that answers late, e^{-j omega delay}.

    Parameters
    ----------
    delay_s : float
        The delay.

    Returns
    -------
    callable
        H (n,) of angular frequencies (n,) in rad/s.
    """
    return lambda omega: np.exp(-1j * omega * delay_s)


def demodulated(carrier_rad_s: float, window_s: float, delay_s: float = 0.0) -> Filter:
    """Return the filter of a loop on demodulated amplitudes: their mean over a window, then a delay.

    H = (h(omega - carrier) - h(omega + carrier)) carrier/omega, h(d) = sinc(d window/2) e^{-j d (window/2 + delay)}:
    the second part is the image at minus the carrier; carrier/omega because displacement stands for velocity. The
    carrier's own phase is compensated.

    Parameters
    ----------
    carrier_rad_s : float
        Angular frequency of the carrier in rad/s.
    window_s : float
        Length of the mean.
    delay_s : float, optional
        Delay after the mean.

    Returns
    -------
    callable
        H (n,) of angular frequencies (n,) in rad/s.
    """

    def mean(d: FloatArray) -> ComplexArray:
        return np.asarray(np.sinc(d * window_s / (2.0 * pi)) * np.exp(-1j * d * (window_s / 2.0 + delay_s)))

    return lambda omega: (mean(omega - carrier_rad_s) - mean(omega + carrier_rad_s)) * carrier_rad_s / omega


def instability_gain_n_s_m(beam: FreeBeam, layout: Layout, high_n_s_m: float) -> float:
    """Find the least damper at which some pole crosses into growth.

    Parameters
    ----------
    beam : FreeBeam
        The beam.
    layout : Layout
        Points of the loops.
    high_n_s_m : float
        Largest damper c of the scan, in N s/m; the scan begins at 1e-9 times this.

    Returns
    -------
    float
        Damper c in N s/m; inf when no pole crosses on the scan.
    """

    def growth(damper: float) -> float:
        return growth_per_s(beam, layout, damper)

    scan = np.geomspace(1e-9 * high_n_s_m, high_n_s_m, 91)
    for low, high in pairwise(scan):
        if growth(float(high)) > 0.0:
            return float(brentq(growth, low, high, rtol=1e-6)) if growth(float(low)) < 0.0 else float(low)
    return inf


def active_beam_study(data: ActiveBeamData | None = None) -> ActiveBeamStudy:
    """Compute closed-loop shapes, forces, stability and sensitivity of active pillars on a free-free strip.

    Parameters
    ----------
    data : ActiveBeamData, optional
        Strip, loops and frequencies; by default the study's own.

    Returns
    -------
    ActiveBeamStudy
        Results by layout, frequency and gain.

    Raises
    ------
    SolverError
        If a gain or a frequency is not above 0, or a frequency is that of a lossless resonance.
    """
    data = ActiveBeamData() if data is None else data
    _check(data)
    beam, left = data.beam, data.place_m
    x = np.linspace(0.0, data.length_m, STEPS + 1)
    layouts = loop_layouts(left, data.apart_m, data.length_m)
    cases = [
        _case(data, layout, frequency, gain, x)
        for frequency in data.frequencies_hz
        for layout in layouts
        for gain in data.gains_n_m
    ]
    opened = [
        data.force_n * np.abs(beam.receptance(x, data.length_m / 2.0, 2j * pi * f)[:, 0]) for f in data.frequencies_hz
    ]
    gains = np.geomspace(1e-3, 1e3, 61) * beam.point_stiffness_n_m(2.0 * pi * data.frequencies_hz[0])
    places = np.linspace(1.5 * data.apart_m, data.length_m / 2.0 - data.apart_m, 61)
    first, coarse = data.frequencies_hz[0], x[::5]
    return ActiveBeamStudy(
        data=data,
        left_m=left,
        x_m=x,
        open_m=np.stack(opened),
        cases=tuple(cases),
        stability=tuple(_stability(data, layout) for layout in layouts),
        sweep_gains_n_m=gains,
        gain_sweep={
            layout.name: np.array([_case(data, layout, first, gain, coarse).after.ratio for gain in gains])
            for layout in layouts
        },
        sweep_places_m=places,
        place_sweep=_place_sweep(data, places, coarse),
    )


def _direct(roots: ComplexArray, distance: FloatArray, derivative: int) -> ComplexArray:
    """Derivatives outwards of sum e^{p|d|}/(4 p^3), the shape of distance."""
    d = np.abs(np.asarray(distance))[..., None]
    return np.asarray(np.sum(roots**derivative * np.exp(roots * d) / (4.0 * roots**3), axis=-1))


def _return_ratio(beam: FreeBeam, layout: Layout, omega: FloatArray) -> ComplexArray:
    """j omega C G(j omega) B, (n, loops, loops)."""
    moved = beam.receptance(layout.points_m, layout.points_m, 1j * omega)
    return np.asarray(1j * omega[:, None, None] * (layout.pick @ moved @ layout.spread))


def _grid(beam: FreeBeam, low: float, high: float) -> FloatArray:
    """Logarithmic, with clusters at the natural frequencies as wide as their damping, as long as that is below half."""
    top = min(high, 1.0 / beam.viscosity_s) if beam.viscosity_s > 0.0 else high
    count = 3
    while beam.natural_rad_s(count)[-1] < top:
        count += max(4, count // 4)
    tones = beam.natural_rad_s(count)[2:]
    tones = tones[tones < top]
    widths = np.maximum(0.5 * beam.viscosity_s * tones**2, 1e-9 * tones)
    offsets = np.sinh(np.linspace(-8.0, 8.0, 121)) / 4.0
    clusters = (tones[:, None] + widths[:, None] * offsets).ravel()
    every = np.concatenate([np.geomspace(low, high, 2000), clusters])
    return np.unique(every[(every >= low) & (every <= high)])


def _crossings(loci: Loci, level: FloatArray, values: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Values (n, loops) and frequencies where a level (n, loops) changes its sign, interpolated."""
    i, k = np.nonzero((level[:-1] < 0.0) != (level[1:] < 0.0))
    share, omega = level[i, k] / (level[i, k] - level[i + 1, k]), loci.omega_rad_s
    return values[i, k] + share * (values[i + 1, k] - values[i, k]), omega[i] + share * (omega[i + 1] - omega[i])


def _place_sweep(data: ActiveBeamData, places: FloatArray, x: FloatArray) -> dict[str, FloatArray]:
    """rms ratio of the three dual layouts over the place of the loops, each frequency, the last gain."""
    moved = [loop_layouts(at, data.apart_m, data.length_m)[:3] for at in places]
    return {
        f"{dual[0].name} at {frequency:g} Hz": np.array(
            [_case(data, layout, frequency, data.gains_n_m[-1], x).after.ratio for layout in dual]
        )
        for dual in zip(*moved, strict=True)
        for frequency in data.frequencies_hz
    }


def _check(data: ActiveBeamData) -> None:
    if not data.gains_n_m or not all(isfinite(gain) and gain > 0.0 for gain in data.gains_n_m):
        raise SolverError(f"gains K' = {data.gains_n_m} N/m: must be finite and above 0 (0 leaves the loops open)")
    if not data.frequencies_hz or not all(isfinite(f) and f > 0.0 for f in data.frequencies_hz):
        raise SolverError(f"frequencies {data.frequencies_hz} Hz: must be finite and above 0")
    if isnan(data.quality_factor) or data.quality_factor <= 0.0 or not (isfinite(data.force_n) and data.force_n > 0.0):
        raise SolverError("quality factor and excitation force must be above 0")
    if not all(isfinite(delay) and delay >= 0.0 for delay in data.delays_s):
        raise SolverError(f"delays {data.delays_s} s: must be finite, 0 or more")


def _case(data: ActiveBeamData, layout: Layout, frequency_hz: float, gain: float, x: FloatArray) -> Case:
    beam, omega, middle = data.beam, 2.0 * pi * frequency_hz, data.length_m / 2.0
    before = forced(beam, layout, 0.0, omega, x, middle)
    after = forced(beam, layout, gain, omega, x, middle)
    signals = layout.pick @ beam.receptance(layout.points_m, middle, 1j * omega)
    return Case(
        layout=layout.name,
        frequency_hz=frequency_hz,
        gain_n_m=float(gain),
        strength=float(gain) / beam.point_stiffness_n_m(omega),
        steady=after,
        before=confinement(x, data.force_n * before.deflection, layout.region_m),
        after=confinement(x, data.force_n * after.deflection, layout.region_m),
        largest_force_n=data.force_n * float(np.max(np.abs(after.forces))),
        switch_on_force_n=data.force_n * float(gain) * float(np.max(np.abs(signals))),
    )


def _stability(data: ActiveBeamData, layout: Layout) -> LoopStability:
    beam, omega = data.beam, 2.0 * pi * data.frequencies_hz[0]
    growth = tuple(growth_per_s(beam, layout, gain / omega) for gain in data.gains_n_m)
    highest = 10.0 * max(data.gains_n_m) / omega
    unstable = inf if layout.dual else instability_gain_n_s_m(beam, layout, highest)
    stable = [gain / omega < unstable for gain in data.gains_n_m]
    filters = [delayed(delay) for delay in data.delays_s]
    filters.append(demodulated(omega, 1.0 / data.frequencies_hz[0]))
    margins: list[float | None]
    if beam.viscosity_s == 0.0:  # infinitely many modes without losses: any delay drives some of them at any gain
        limits, margins = [(0.0, nan)] * len(filters), [0.0 if holds else None for holds in stable]
    else:
        loci = characteristic_loci(beam, layout, _highest_hz(beam, layout, highest))
        limits = [gain_limit_n_s_m(loci, one) for one in filters]
        margins = [
            delay_margin_s(loci, gain / omega) if holds else None
            for gain, holds in zip(data.gains_n_m, stable, strict=True)
        ]
    return LoopStability(
        layout=layout.name,
        dual=layout.dual,
        growth_per_s=growth,
        unstable_from_n_m=unstable * omega,
        delay_margin_s=tuple(margins),
        gain_limits_n_m=tuple(limit * omega for limit, _ in limits),
        gain_limits_hz=tuple(hz for _, hz in limits),
    )
