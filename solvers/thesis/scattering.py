"""Flexural waves that meet resonators, a point force or a moment, on a beam or on a strip with a row of pillars."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan, pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from solvers.analytic.beams import Beam
from solvers.analytic.predesign import pillar_beam, pillar_frequencies_hz
from solvers.errors import SolverError, checked_frequencies, solved

PINNED = 1e9  # s that stands for infinity: |t|^2 = 1/2 to a billionth
SPAN = 2.0  # wavelengths shown on each side
KINDS = (("spring", 1.0, 0), ("pinned", PINNED, 0), ("printed damper", -1j, 0), ("moment", -1.0, 1))

DECAYS_DB = 0.01  # per row: below it a wave counts as passing


@dataclass(frozen=True)
class HostBeam:
    """The infinite Euler-Bernoulli beam: EI in N m2, rho A in kg/m."""

    bending_n_m2: float
    mass_kg_m: float

    def wavenumber_per_m(self, omega: ArrayLike) -> FloatArray:
        """beta = (rho A omega^2/EI)^(1/4), rad/m; SolverError unless every frequency is finite and above 0."""
        w = np.atleast_1d(checked_frequencies(omega))
        return np.asarray((self.mass_kg_m * w**2 / self.bending_n_m2) ** 0.25)


@dataclass(frozen=True)
class Scattering:
    """Far-field amplitudes over n frequencies: reflected r e^{-i beta x}, transmitted t e^{i beta x}, shape (n,).

    loads: force and moment on the host at every resonator for a unit incident wave, shape (n, resonators, 2), N and N m.
    """

    reflection: ComplexArray
    transmission: ComplexArray
    loads: ComplexArray

    @property
    def absorbed(self) -> FloatArray:
        """1 - |r|^2 - |t|^2, the share of power that the resonators keep, shape (n,)."""
        return np.asarray(1.0 - np.abs(self.reflection) ** 2 - np.abs(self.transmission) ** 2)


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
    """x over the wavelength (n,), and the scattering of a unit wave from the left at each kind of point."""

    x_over_wavelength: FloatArray
    cases: tuple[ScatteringCase, ...]

    def of(self, name: str) -> ScatteringCase:
        """The case of a name. SolverError without one."""
        for case in self.cases:
            if case.name == name:
                return case
        raise SolverError(f"no case {name!r}: there are {', '.join(case.name for case in self.cases)}")

    def to_dict(self) -> dict[str, Any]:
        """Powers and the deflection's size in shares of the incident ones."""
        known = ("name", "transmitted", "reflected", "absorbed")
        cases = [{key: getattr(case, key) for key in known} | {"abs": np.abs(case.deflection)} for case in self.cases]
        return {"x_over_wavelength": self.x_over_wavelength, "cases": cases}


@dataclass(frozen=True)
class PillarFilter:
    """Results over n frequencies: |t|^2 and |r|^2 of 1 ... rows pillars, shape (rows, n), decay of an infinite row (n,), dB.

    clamped_hz: the pillar on a rigid foot (Timoshenko); stopped_hz: where one pillar's moment lets nothing through;
    oscillator_stopped_hz: the same for a vertical oscillator of the pillar's mass and clamped frequency. bands_hz: the
    widest stretch with |t|^2 <= 1/2 for 1 ... rows pillars; stop_hz: the widest in which the infinite row passes no wave
    without losses (decay above 0.01 dB per row); None without any in the window.
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


def strengths(host_beam: HostBeam, feet: ComplexArray, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
    """Compute the dimensionless force and moment strengths of a foot, K_ww/(4 EI beta^3) and K_tt/(4 EI beta).

    Parameters
    ----------
    host_beam : HostBeam
        The beam under the foot.
    feet : ndarray, shape (n, 2, 2)
        Foot stiffness over (w, w_x) at each frequency, in N/m, N and N m.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s.

    Returns
    -------
    force, moment : ndarray, shape (n,)
        Strengths, complex with losses.
    """
    beta, ei = host_beam.wavenumber_per_m(omega), host_beam.bending_n_m2
    return feet[:, 0, 0] / (4.0 * ei * beta**3), feet[:, 1, 1] / (4.0 * ei * beta)


def scatter(host_beam: HostBeam, feet: ComplexArray, places_m: Sequence[float], omega: ArrayLike) -> Scattering:
    """Compute the waves that one or several equal resonators scatter, near fields included.

    w = e^{i beta x} + sum of F_j g(x - x_j) - M_j g'(x - x_j), g = (i e^{i beta|x|} - e^{-beta|x|})/(4 EI beta^3), and
    (F_j, M_j) = -K (w, w_x) at x_j.

    Parameters
    ----------
    host_beam : HostBeam
        The infinite beam.
    feet : ndarray, shape (n, 2, 2)
        Foot stiffness K of every resonator over (w, w_x) at each frequency, in N/m, N and N m.
    places_m : sequence of float
        Places x_j of the resonators, all different.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s.

    Returns
    -------
    Scattering
        Far-field amplitudes for a unit wave from the left, and the loads of the resonators.

    Raises
    ------
    SolverError
        If there is no place, two resonators share one, or the system is singular.

    References
    ----------
    .. [1] graff1975 (docs/references.bib)
    """
    beta, places = host_beam.wavenumber_per_m(omega), np.asarray(places_m, dtype=float)
    if places.size == 0 or np.unique(places).size < places.size or not np.all(np.isfinite(places)):
        raise SolverError("places of the resonators must be finite, at least one, all different")
    loads = np.stack([_loads(host_beam, k, foot, places) for k, foot in zip(beta, feet, strict=True)])
    phase = np.exp(1j * beta[:, None] * places)
    force, moment = loads[..., 0] / (4.0 * host_beam.bending_n_m2), loads[..., 1] / (4.0 * host_beam.bending_n_m2)
    cubed, squared = beta[:, None] ** 3, beta[:, None] ** 2
    reflection = np.sum((1j * force / cubed - moment / squared) * phase, axis=1)
    transmission = 1.0 + np.sum((1j * force / cubed + moment / squared) * phase.conj(), axis=1)
    return Scattering(reflection, transmission, loads)


def field(
    host_beam: HostBeam, scattering: Scattering, places_m: Sequence[float], omega: ArrayLike, x_m: ArrayLike
) -> ComplexArray:
    """Compute the deflection of the host for a unit incident wave.

    Parameters
    ----------
    host_beam : HostBeam
        The infinite beam.
    scattering : Scattering
        Result of `scatter` for the same beam, places and frequencies.
    places_m : sequence of float
        Places of the resonators.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s.
    x_m : array_like, shape (points,)
        Places of the deflection.

    Returns
    -------
    ndarray, shape (n, points)
        Complex deflection relative to the incident wave's.
    """
    beta, x = host_beam.wavenumber_per_m(omega), np.asarray(x_m, dtype=float)
    rows = []
    for k, loads in zip(beta, scattering.loads, strict=True):
        g = _green(host_beam, k, x[:, None] - np.asarray(places_m, dtype=float))
        rows.append(np.exp(1j * k * x) + g[0] @ loads[:, 0] - g[1] @ loads[:, 1])
    return np.stack(rows)


def transfer_matrix(host_beam: HostBeam, foot: ComplexArray, pitch_m: float, omega: float) -> ComplexArray:
    """Return the transfer matrix from just before one resonator to just before the next.

    T = free beam over the pitch times the jump of moment and shear at the foot.

    Parameters
    ----------
    host_beam : HostBeam
        The beam between the resonators.
    foot : ndarray, shape (2, 2)
        Foot stiffness over (w, w_x), in N/m, N and N m.
    pitch_m : float
        Distance between resonators.
    omega : float
        Angular frequency in rad/s.

    Returns
    -------
    ndarray, shape (4, 4)
        T over the state (w, w_x/beta, w_xx/beta^2, w_xxx/beta^3).
    """
    beta, ei = float(host_beam.wavenumber_per_m(omega)[0]), host_beam.bending_n_m2
    s, c = np.sin(beta * pitch_m), np.cos(beta * pitch_m)
    sh, ch = np.sinh(beta * pitch_m), np.cosh(beta * pitch_m)
    even, odd = (ch + c) / 2.0, (sh + s) / 2.0
    minus_even, minus_odd = (ch - c) / 2.0, (sh - s) / 2.0
    free = np.array(
        [
            [even, odd, minus_even, minus_odd],
            [minus_odd, even, odd, minus_even],
            [minus_even, minus_odd, even, odd],
            [odd, minus_even, minus_odd, even],
        ]
    )
    jump = np.eye(4, dtype=complex)
    jump[2, :2] = foot[1] * np.array([1.0, beta]) / (ei * beta**2)
    jump[3, :2] = -foot[0] * np.array([1.0, beta]) / (ei * beta**3)
    return np.asarray(free @ jump)


def decay_db_per_row(host_beam: HostBeam, feet: ComplexArray, pitch_m: float, omega: ArrayLike) -> FloatArray:
    """Compute the decay of the least attenuated Bloch wave of an infinite row of resonators.

    Parameters
    ----------
    host_beam : HostBeam
        The beam between the resonators.
    feet : ndarray, shape (n, 2, 2)
        Foot stiffness over (w, w_x) at each frequency, in N/m, N and N m.
    pitch_m : float
        Distance between resonators.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s.

    Returns
    -------
    ndarray, shape (n,)
        Decay in dB per resonator, 0 or more.
    """
    pairs = zip(np.atleast_1d(omega), feet, strict=True)
    matrices = np.stack([transfer_matrix(host_beam, foot, pitch_m, float(value)) for value, foot in pairs])
    # with s = lambda + 1/lambda of each pair: s_1 + s_2 = tr T, and s_1 s_2 = ((tr T)^2 - tr T^2)/2 - 2
    trace, squared = (np.trace(each, axis1=1, axis2=2) for each in (matrices, matrices @ matrices))
    root = np.sqrt(trace**2 - 4.0 * ((trace**2 - squared) / 2.0 - 2.0) + 0j)
    sums = np.array([(trace + root) / 2.0, (trace - root) / 2.0])  # lambda + 1/lambda of each pair
    outer = np.sqrt(sums**2 - 4.0 + 0j)
    larger = np.maximum(np.abs(sums + outer), np.abs(sums - outer)) / 2.0
    return np.asarray(20.0 * np.log10(larger.min(axis=0)))


def half_power_band(transmitted: FloatArray, omega: FloatArray) -> tuple[float, float] | None:
    """Find the widest stretch of frequencies with |t|^2 <= 1/2, its ends by linear interpolation.

    Parameters
    ----------
    transmitted : ndarray, shape (n,)
        Transmitted share of power, |t|^2.
    omega : ndarray, shape (n,)
        Frequencies, ascending, in any unit.

    Returns
    -------
    tuple of float, or None
        Ends in the unit of `omega`; None where |t|^2 stays above 1/2.
    """
    below = np.concatenate([[False], np.asarray(transmitted) <= 0.5, [False]])
    edges = np.flatnonzero(np.diff(below.astype(int)))
    if edges.size == 0:
        return None
    starts, ends = edges[::2], edges[1::2] - 1
    i = int(np.argmax(omega[ends] - omega[starts]))

    def crossing(inside: int, outside: int) -> float:
        if not 0 <= outside < len(omega):
            return float(omega[inside])
        share = (0.5 - transmitted[inside]) / (transmitted[outside] - transmitted[inside])
        return float(omega[inside] + share * (omega[outside] - omega[inside]))

    return crossing(int(starts[i]), int(starts[i]) - 1), crossing(int(ends[i]), int(ends[i]) + 1)


def oscillator_total_reflection_rad_s(host_beam: HostBeam, mass_kg: float, resonance_rad_s: float) -> float:
    """Compute the frequency at which an undamped vertical oscillator reflects everything.

    w^2 = w0^2 [1 + m beta(w)/(4 rho A)], above w0.

    Parameters
    ----------
    host_beam : HostBeam
        The beam under the oscillator.
    mass_kg : float
        Mass m of the oscillator.
    resonance_rad_s : float
        Its resonance w0 on a rigid foot, in rad/s.

    Returns
    -------
    float
        Angular frequency in rad/s.
    """
    own = np.sqrt(resonance_rad_s)
    added = mass_kg * float(host_beam.wavenumber_per_m(resonance_rad_s)[0]) / (4.0 * host_beam.mass_kg_m)
    roots = np.roots([1.0, 0.0, 0.0, -added, -1.0])  # of sqrt(w/w0), as which beta grows; the largest is above 1
    return float((own * roots.real.max()) ** 2)


def moment_total_reflection_rad_s(
    host_beam: HostBeam, foot_of: Callable[[float], ComplexArray], clamped_rad_s: float
) -> float:
    """Compute the frequency at which the foot moment of a lossless pillar reflects everything: K_tt = -4 EI beta.

    K_tt falls from 0 to minus infinity as the frequency rises to the pillar's clamped resonance (Foster), so there is
    one.

    Parameters
    ----------
    host_beam : HostBeam
        The beam under the pillar.
    foot_of : callable
        Foot stiffness (1, 2, 2) at an angular frequency in rad/s.
    clamped_rad_s : float
        First resonance of the pillar on a rigid foot, in rad/s.

    Returns
    -------
    float
        Angular frequency in rad/s, below the clamped resonance.
    """

    def excess(omega: float) -> float:
        return float(strengths(host_beam, foot_of(omega), omega)[1][0].real) + 1.0

    return float(brentq(excess, 1e-3 * clamped_rad_s, (1.0 - 1e-9) * clamped_rad_s, xtol=1e-12 * clamped_rad_s))


def point_force(points: int = 801) -> PointForce:
    """Scatter a unit wave at a spring s = 1, a pinned point, the printed damper s = -i and a moment s = -1.

    s = K_ww/(4 EI beta^3) of a force -K w(0), or K_tt/(4 EI beta) of a moment -K w'(0). Total reflection takes the
    force +4 i EI beta^3 W_p, which the spring's is; the printed -4 i EI beta^3 W_p doubles the wave instead.
    The printed force by itself is the last case.

    Parameters
    ----------
    points : int, optional
        Number of places along the beam, from -2 to 2 wavelengths.

    Returns
    -------
    PointForce
        Deflection and shares of power of the five cases.

    Raises
    ------
    SolverError
        If there are fewer than two points.
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


def pillar_foot(beam: Beam, omega: ArrayLike, axial_n: float, loss: float = 0.0, lever_m: float = 0.0) -> ComplexArray:
    """Compute the dynamic stiffness of a pillar on its foot.

    The foot's rotation bends it, its deflection stretches it: K_ww = -rho A omega^2 h B/(kh), k^2 = rho A omega^2/EA,
    B = tan(kh) without a body on the tip, with one of M = m rho A h (sin kh + m kh cos kh)/(cos kh - m kh sin kh);
    K_tt = D_tt + 2 e D_ut + e^2 D_uu with the bending stiffness D of the foot.

    Parameters
    ----------
    beam : Beam
        The pillar, uniform, its tip free or with a rigid body; shear_n = inf and rotary_kg_m = 0 are Euler-Bernoulli's.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s.
    axial_n : float
        Stretching stiffness EA in N.
    loss : float, optional
        Loss factor eta of E (1 - i eta), dimensionless.
    lever_m : float, optional
        Height e of the foot above the host's neutral line, which stays at rest along x.

    Returns
    -------
    ndarray, shape (n, 2, 2)
        Complex stiffness over (w, w_x), diagonal: K_ww in N/m and K_tt in N m.
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
    """Compute the dynamic stiffness of a uniform beam's end s = 0, the other end free or with a rigid body.

    From the four exact waves exp(lambda s), lambda^4 + (b + r O^2) lambda^2 + r O^2 b - O^2 = 0, O the dimensionless
    frequency with E (1 - i loss). Euler-Bernoulli: K_tt = -EI beta (sin cosh - cos sinh)/(1 + cos cosh) of beta L.

    Parameters
    ----------
    beam : Beam
        The beam, Timoshenko's or Euler-Bernoulli's.
    omega : float
        Angular frequency in rad/s.
    loss : float, optional
        Loss factor of E (1 - i loss), dimensionless.

    Returns
    -------
    ndarray, shape (2, 2)
        Complex stiffness over (displacement, rotation), in N/m, N and N m.

    Raises
    ------
    SolverError
        If the beam is tapered.
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


def strip_beam(design: Design) -> HostBeam:
    """Return the strip of one pitch as a beam: bending stiffness D pitch of a plate kept straight along x.

    Parameters
    ----------
    design : Design
        Design with a stack and a pitch along x.

    Returns
    -------
    HostBeam
        The strip without pillars.

    Raises
    ------
    SolverError
        If the pitch or the thickness is missing.
    """
    stack, width = design.stack, design.pitch_x_m
    if isnan(width) or isnan(design.thickness_m):
        raise SolverError("the strip needs a pitch and a thickness")
    return HostBeam(float(stack.bending_n_m[1, 1]) * width, stack.mass_kg_m2 * width)


def pillar_filter(design: Design, frequencies_hz: FloatArray, loss: float = 0.0) -> PillarFilter:
    """Scatter a flexural wave at normal incidence at the design's rows of pillars.

    The foot stands half a thickness above the neutral line.

    Parameters
    ----------
    design : Design
        Design with pillar, pitches, rows and thickness.
    frequencies_hz : ndarray, shape (n,)
        Frequencies, ascending.
    loss : float, optional
        Loss factor of E (1 - i loss) in the pillar, dimensionless.

    Returns
    -------
    PillarFilter
        Shares of power of 1 row to all rows, and the decay of an infinite number of them.

    Raises
    ------
    SolverError
        If the pillar, a pitch or the thickness is missing.
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
    """Compute the foot stiffness of a design's pillar, or of both on opposite faces.

    It is diagonal, so that the mirror image adds the same.

    Parameters
    ----------
    pillar : Pillar
        Pillar on one or both faces.
    omega : ndarray, shape (n,)
        Angular frequencies in rad/s.
    loss : float, optional
        Loss factor of E (1 - i loss), dimensionless.
    lever_m : float, optional
        Height of the foot above the host's neutral line.

    Returns
    -------
    ndarray, shape (n, 2, 2)
        Stiffness of all feet at a place over (w, w_x), as of `pillar_foot`.
    """
    axial = pillar.material.rod(2).young_pa * pillar.form.section.area_m2
    return pillar.faces * pillar_foot(pillar_beam(pillar, about_x=True), omega, axial, loss, lever_m)


def _green(host_beam: HostBeam, beta: float, x: FloatArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """g, g' and g'' of a unit point force at 0."""
    wave, near, sign = np.exp(1j * beta * np.abs(x)), np.exp(-beta * np.abs(x)), np.sign(x)
    scale = 1.0 / (4.0 * host_beam.bending_n_m2 * beta**3)
    return scale * (1j * wave - near), scale * beta * sign * (near - wave), -scale * beta**2 * (near + 1j * wave)


def _loads(host_beam: HostBeam, beta: float, foot: ComplexArray, places: FloatArray) -> ComplexArray:
    """Forces and moments of every resonator, shape (resonators, 2): (1 + G K) u = incident, load = -K u."""
    count = places.size
    g, slope, curve = _green(host_beam, beta, places[:, None] - places[None, :])
    mobility = np.empty((count, 2, count, 2), dtype=complex)
    mobility[:, 0, :, 0], mobility[:, 0, :, 1] = g, -slope
    mobility[:, 1, :, 0], mobility[:, 1, :, 1] = slope, -curve
    incident = np.exp(1j * beta * places)[:, None] * np.array([1.0, 1j * beta])
    scale = np.array([1.0, beta])  # w and w_x/beta: both equations of one size
    matrix = np.eye(2 * count) + np.einsum("iajb,bc->iajc", mobility, foot).reshape(2 * count, 2 * count)
    matrix = matrix * np.tile(scale, count)[None, :] / np.tile(scale, count)[:, None]
    trouble = "the resonators and the beam form a singular system at this frequency"
    motion = solved(matrix, (incident / scale).ravel(), trouble)
    return np.asarray(-(motion.reshape(count, 2) * scale) @ foot.T)


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
