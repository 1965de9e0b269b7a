"""Analytic sizing: the zone's mode, the pillar that resonates with it, and the limits of the theories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf, isnan, pi, sqrt
from typing import Literal

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design, Pillar, Section, half_wavelength_m
from solvers.analytic.beams import (
    Beam,
    EndBody,
    beam_of,
    exact_omegas,
    frequency_hz,
    ritz_frequencies_hz,
    root_between,
    roots,
)
from solvers.analytic.layered import sheared
from solvers.analytic.plates import (
    MAX_LINES,
    Strip,
    beam_function_hz,
    kirchhoff_mode,
    levy_along_per_m2,
    levy_hz,
    mindlin_mode,
)
from solvers.analytic.stepped import chain_frequencies_hz
from solvers.errors import SolverError, check_above_zero

Theory = Literal["euler", "timoshenko"]
FINGER_M = 0.020  # width of a fingertip: the half-wavelength should be smaller


@dataclass(frozen=True)
class ZoneSize:
    """The zone's mode (0, N), Hz and m. frequency_hz is the exact thin plate with pinned sides (Levy), of several layers with
    their shear.

    formula_hz: beam function between pinned sides. pinned_hz, clamped_hz: with shear (Mindlin; of several layers their own
    waves'); thin_clamped_hz:
    Kirchhoff; these three are None beyond N = 40. half_wavelength_m: pi/k of the free-free beam shape.
    """

    nodal_lines: int
    frequency_hz: float
    half_wavelength_m: float | None
    formula_hz: float
    node_spacing_m: float | None
    pinned_hz: float | None
    thin_clamped_hz: float | None
    clamped_hz: float | None


@dataclass(frozen=True)
class PillarSize:
    """The pillar whose first bending (Euler-Bernoulli, foot clamped) meets the zone's frequency; Hz and m.

    timoshenko_height_m does the same with shear. given_*: the case's own pillar by both theories, second bending too.
    """

    height_m: float
    frequency_hz: float
    timoshenko_height_m: float
    given_height_m: float
    given_euler_hz: float
    given_timoshenko_hz: float
    given_second_hz: float


@dataclass(frozen=True)
class Predesign:
    """Sizes and their limits; zone or pillar is None when the design has none."""

    zone: ZoneSize | None
    pillar: PillarSize | None
    limits: tuple[str, ...]


def predesign(design: Design) -> Predesign:
    """Size the zone and the pillar of a design by beam and plate theory; lengths that are NaN count as not given.

    Parameters
    ----------
    design : Design
        Lengths in m.

    Returns
    -------
    Predesign
        Sizes in m, frequencies in Hz, and the limits of the theories.
    """
    strip = strip_of(design)
    zone = _zone_size(strip, design.nodal_lines) if strip else None
    pillar = _pillar_size(design.pillar, zone.frequency_hz if zone else None) if design.pillar else None
    return Predesign(zone, pillar, tuple(_limits(design, zone, pillar)))


def strip_of(design: Design) -> Strip | None:
    """Return the isolated zone of a design.

    Parameters
    ----------
    design : Design
        Lengths in m.

    Returns
    -------
    Strip or None
        None if it has no zone or no thickness.
    """
    if any(isnan(size) for size in (design.length_m, design.width_m, design.thickness_m)):
        return None
    return Strip(design.length_m, design.width_m, design.stack, design.held_ends)


def free_kx_per_m(design: Design) -> float:
    """Compute the wavenumber along the zone of the target mode by the exact thin plate with pinned sides.

    Parameters
    ----------
    design : Design
        Lengths in m.

    Returns
    -------
    float
        In rad/m; 0 for the shapes that are rigid along x.
    """
    strip = strip_of(design)
    if strip is None or design.half_wavelength_m is None:
        return 0.0
    return sqrt(max(levy_along_per_m2(strip, design.nodal_lines), 0.0))


BENDS = 0.05  # of the first frequency: upper sections that change it by more bend


def pillar_beam(pillar: Pillar, height_m: float | None = None, about_x: bool = False) -> Beam:
    """Model the pillar as a beam on its clamped foot, without fillet; sections above the first one are a rigid body on its end.

    Parameters
    ----------
    pillar : Pillar
        Sizes in m.
    height_m : float, optional
        In the place of its first section's height.
    about_x : bool, optional
        Bend it about x, else about the axis where it is weaker.

    Returns
    -------
    Beam
        In SI units.

    Raises
    ------
    SolverError
        If sections above the first one bend: together they are then not a rigid body.
    """
    beam = _section_beam(pillar, pillar.height_m if height_m is None else height_m, about_x)
    if not pillar.upper:
        return beam
    beam = replace(beam, end=upper_body(pillar.upper))
    rigid = ritz_frequencies_hz(beam, "clamped", "free", 1)[0]
    bent = chain_frequencies_hz([_section_beam(part, part.height_m, about_x) for part in pillar.parts], 1)[0]
    if rigid > (1.0 + BENDS) * bent:
        share = 100.0 * (rigid / bent - 1.0)
        raise SolverError(
            f"the pillar's upper sections bend: rigid ones would raise its first frequency by {share:.0f} %; compute its solid"
        )
    return beam


def _section_beam(part: Pillar | Section, height_m: float, about_x: bool) -> Beam:
    """One section as a beam."""
    form, material = part.form, part.material
    section = form.section
    about = section.about_x_m4 if about_x else min(section.about_x_m4, section.about_y_m4)
    beam = beam_of(height_m, section.area_m2, about, form.shear_factor(material.rod(2).poisson), material)
    slope = form.taper - 1.0
    return replace(beam, width_ratio=lambda s: 1.0 + slope * s) if slope else beam


def upper_body(sections: Sequence[Section]) -> EndBody:
    """Model sections of a pillar as one rigid body: their masses, and their inertia about their common centre.

    Parameters
    ----------
    sections : sequence of Section
        One on top of the other, taken as prisms.

    Returns
    -------
    EndBody
        Mass in kg, moment of inertia in kg m^2 and arm in m above the lowest one's foot.
    """
    ends = np.cumsum([section.height_m for section in sections])
    masses, heights = (np.array([getattr(section, name) for section in sections]) for name in ("mass_kg", "height_m"))
    middles = ends - heights / 2.0
    mass, centre = masses.sum(), masses @ middles / masses.sum()
    turned = np.array([section.form.section.about_x_m4 / section.form.section.area_m2 for section in sections])
    inertia = masses @ (turned + heights**2 / 12.0 + (middles - centre) ** 2)
    return EndBody(float(mass), float(inertia), float(centre))


def pillar_frequencies_hz(
    pillar: Pillar, theory: Theory, count: int = 1, height_m: float | None = None, about_x: bool = False
) -> FloatArray:
    """Compute the first bending frequencies of the pillar on its clamped foot.

    Parameters
    ----------
    pillar : Pillar
        Sizes in m.
    theory : {"euler", "timoshenko"}
        Without or with shear and rotary inertia.
    count : int, optional
        Number of frequencies.
    height_m : float, optional
        In the place of the pillar's own height, or of its highest section's (`Pillar.highest`).
    about_x : bool, optional
        Bend it about x, else about the axis where it is weaker.

    Returns
    -------
    ndarray, shape (count,)
        In Hz.
    """
    if pillar.upper:
        heights = [section.height_m for section in pillar.parts]
        heights[pillar.highest] = heights[pillar.highest] if height_m is None else height_m
        chain = [_section_beam(*each, about_x) for each in zip(pillar.parts, heights, strict=True)]
        return chain_frequencies_hz(chain, count, theory == "euler")
    beam = pillar_beam(pillar, height_m, about_x)
    if beam.width_ratio is not None:
        return ritz_frequencies_hz(beam, "clamped", "free", count, rigid_shear=theory == "euler")
    if theory == "timoshenko":
        return np.array(exact_omegas(beam, "clamped", "free", count)) * beam.unit_rad_s / (2.0 * pi)
    return frequency_hz(np.array(roots("clamped", "free", count)), beam.length_m, beam.bending_n_m2, beam.mass_kg_m)


def pillar_height_m(pillar: Pillar, target_hz: float, theory: Theory) -> float:
    """Find the height whose first bending frequency is a given one, for the same cross-sections; of several sections that of
    the highest one.

    Parameters
    ----------
    pillar : Pillar
        Sizes in m.
    target_hz : float
        The frequency.
    theory : {"euler", "timoshenko"}
        Without or with shear and rotary inertia.

    Returns
    -------
    float
        In m.

    Raises
    ------
    SolverError
        Unless target_hz is above 0.
    """
    check_above_zero("frequency", target_hz)

    def first_hz(height_m: float) -> float:
        return float(pillar_frequencies_hz(pillar, theory, 1, height_m)[0])

    return _solved(lambda height: first_hz(height) - target_hz, pillar.parts[pillar.highest].height_m)


def zone_width_m(strip: Strip, nodal_lines: int, target_hz: float) -> float:
    """Find the width between pinned sides that gives the mode (0, N) a frequency (Levy).

    Parameters
    ----------
    strip : Strip
        Length and layers of the zone.
    nodal_lines : int
        N.
    target_hz : float
        The frequency.

    Returns
    -------
    float
        In m.

    Raises
    ------
    SolverError
        If even an infinitely wide zone lies above: the bound of N half-waves along x on a free-free beam.
    """
    check_above_zero("frequency", target_hz)
    try:
        return _solved(lambda width: levy_hz(replace(strip, width_m=width), nodal_lines) - target_hz, strip.width_m)
    except SolverError:
        reason = f"no width gives {target_hz:g} Hz with {nodal_lines} nodal lines on {strip.length_m:g} m"
        raise SolverError(f"{reason}: use fewer lines, or a longer or thinner zone") from None


def min_nodal_lines(strip: Strip, half_wavelength_m: float) -> int:
    """Compute the smallest N whose half-wavelength L/(N - 1/2) does not exceed the requested one.

    Parameters
    ----------
    strip : Strip
        Length of the zone.
    half_wavelength_m : float
        Largest half-wavelength.

    Returns
    -------
    int
        At least 2.

    Raises
    ------
    SolverError
        Unless the half-wavelength is above 0.
    """
    check_above_zero("half-wavelength", half_wavelength_m)
    return max(2, ceil(strip.length_m / half_wavelength_m + 0.5 - 1e-9))


def _zone_size(strip: Strip, lines: int) -> ZoneSize:
    along = levy_along_per_m2(strip, lines)
    ritz = strip.doubled(lines)[1] <= MAX_LINES
    return ZoneSize(
        nodal_lines=lines,
        frequency_hz=levy_hz(strip, lines) * sheared(strip, _along_per_m(strip, lines), strip.across_per_m),
        half_wavelength_m=half_wavelength_m(strip.length_m, lines, strip.held),
        formula_hz=beam_function_hz(strip, lines),
        node_spacing_m=pi / sqrt(along) if along > 0.0 else None,
        thin_clamped_hz=kirchhoff_mode(strip, lines, "clamped").frequency_hz if ritz else None,
        **dict(zip(("pinned_hz", "clamped_hz"), _with_shear(strip, lines) if ritz else (None, None), strict=True)),
    )


def _along_per_m(strip: Strip, lines: int) -> float:
    """Wavenumber of the beam shape, rad/m; 0 for rigid shapes."""
    return pi / (half_wavelength_m(strip.length_m, lines, strip.held) or inf)


def _with_shear(strip: Strip, lines: int) -> tuple[float, float]:
    """The mode between pinned and clamped sides, Hz, with shear: Mindlin's of one layer. No single shear stiffness describes
    several layers: the laminate's frequency is corrected as shear changes its wave at the mode's wavevector.
    """
    if len(strip.stack.layers) == 1:
        pinned, clamped = (mindlin_mode(strip, lines, sides).frequency_hz for sides in ("pinned", "clamped"))
        return pinned, clamped
    along = _along_per_m(strip, lines)
    laminate = levy_hz(strip, lines), kirchhoff_mode(strip, lines, "clamped").frequency_hz
    across = strip.across_per_m, roots("clamped", "clamped", 1)[0] / strip.width_m
    pinned, clamped = (tone * sheared(strip, along, each) for tone, each in zip(laminate, across, strict=True))
    return pinned, clamped


def _pillar_size(pillar: Pillar, target_hz: float | None) -> PillarSize:
    euler = float(pillar_frequencies_hz(pillar, "euler")[0])
    first, second = (float(f) for f in pillar_frequencies_hz(pillar, "timoshenko", 2))
    target = euler if target_hz is None else target_hz
    return PillarSize(
        height_m=pillar_height_m(pillar, target, "euler"),
        frequency_hz=target,
        timoshenko_height_m=pillar_height_m(pillar, target, "timoshenko"),
        given_height_m=pillar.parts[pillar.highest].height_m,
        given_euler_hz=euler,
        given_timoshenko_hz=first,
        given_second_hz=second,
    )


def _solved(excess: Callable[[float], float], start: float) -> float:
    """The root of a falling function of a length, bracketed by doubling and halving from `start`."""
    low = next((x for x in (start / 1.5**n for n in range(41)) if excess(x) >= 0.0), None)
    high = next((x for x in (start * 1.5**n for n in range(41)) if excess(x) <= 0.0), None)
    if low is None or high is None:
        raise SolverError("no such length exists")
    return low if low == high else root_between(excess, low, high, 1e-9 * start)


def _limits(design: Design, zone: ZoneSize | None, pillar: PillarSize | None) -> list[str]:
    lines = []
    if zone is not None:
        lines += _zone_limits(design, zone)
    if pillar is not None and design.pillar is not None:
        lines += _pillar_limits(design.pillar, pillar)
        lines += _row_limits(design)
    if zone is not None and zone.half_wavelength_m is not None and not isnan(design.pitch_y_m):
        pitches = {design.pitch_x_m, design.pitch_y_m}
        lines += [
            f"array: the pitch {1e3 * pitch:.3g} mm is 1/{2.0 * zone.half_wavelength_m / pitch:.2g} of the wavelength "
            f"{2e3 * zone.half_wavelength_m:.3g} mm along the zone"
            for pitch in sorted(pitches)
        ]
    return lines


def _zone_limits(design: Design, zone: ZoneSize) -> list[str]:
    error = zone.formula_hz / zone.frequency_hz - 1.0
    lines = [
        f"zone: the beam-function formula gives {zone.formula_hz / 1e3:.3g} kHz, {100 * abs(error):.1f} % "
        f"{'below' if error < 0.0 else 'above'} the exact thin plate's {zone.frequency_hz / 1e3:.3g} kHz: it does not satisfy "
        "the conditions at a plate's free ends"
    ]
    lines = lines if not design.layers and design.held_ends < 2 else []  # the formula knows no shear
    if zone.half_wavelength_m is not None:
        finger = "below" if zone.half_wavelength_m < FINGER_M else "not below"
        lines.append(
            f"zone: half-wavelength {1e3 * zone.half_wavelength_m:.2f} mm is {finger} a fingertip's {1e3 * FINGER_M:g} mm "
            f"and {zone.half_wavelength_m / design.thickness_m:.1f} times the thickness"
        )
    if zone.pinned_hz is None or zone.clamped_hz is None or zone.thin_clamped_hz is None:
        return [*lines, f"zone: shear and clamped sides are not estimated beyond {MAX_LINES} nodal lines"]
    if design.layers:
        change = 100 * (zone.clamped_hz / zone.thin_clamped_hz - 1)
        return [
            *lines,
            f"zone: shear of the layers changes the laminate's frequency by {change:+.1f} % with clamped sides: from "
            f"{zone.pinned_hz / 1e3:.3g} kHz (pinned sides) to {zone.clamped_hz / 1e3:.3g} kHz (clamped sides)",
        ]
    return [
        *lines,
        f"zone: shear and rotary inertia change the frequency by {100 * (zone.pinned_hz / zone.frequency_hz - 1):+.1f} % "
        f"with pinned sides and {100 * (zone.clamped_hz / zone.thin_clamped_hz - 1):+.1f} % with clamped ones (Mindlin)",
        f"zone: between {zone.pinned_hz / 1e3:.3g} kHz (pinned sides) and {zone.clamped_hz / 1e3:.3g} kHz (clamped sides), "
        "depending on how firmly the rows of pillars hold its sides (Mindlin)",
    ]


def _row_limits(design: Design) -> list[str]:
    """Differences from row to row: each row's pillar, next to the first row's, to which the sizes above belong."""
    return [
        f"row {number}: its pillar, {1e3 * pillar.base_m:.3g} mm wide and {1e3 * pillar.height_m:.3g} mm high, bends at "
        f"{pillar_frequencies_hz(pillar, 'timoshenko')[0] / 1e3:.3g} kHz on a clamped foot, shear counted"
        for number, pillar in enumerate(design.graded, start=1)
    ]


def _pillar_limits(pillar: Pillar, size: PillarSize) -> list[str]:
    slenderness = pillar.top_m / pillar.base_m
    change = size.given_timoshenko_hz / size.given_euler_hz - 1.0
    lines = [
        f"pillar: height over width {slenderness:.2f}; shear and rotary inertia change its first frequency by "
        f"{100 * change:+.1f} % ({size.given_euler_hz / 1e3:.3g} to {size.given_timoshenko_hz / 1e3:.3g} kHz at "
        f"{1e3 * size.given_height_m:.3g} mm)",
        f"pillar: {size.frequency_hz / 1e3:.3g} kHz takes {1e3 * size.height_m:.3g} mm without shear, "
        f"{1e3 * size.timoshenko_height_m:.3g} mm with it; the plate under the foot lowers the frequency further",
    ]
    if slenderness < 3.0:
        lines.append(
            f"pillar: height over width {slenderness:.2f} is below 3: beam theory is only a guess; compute the solid"
        )
    if pillar.upper:
        lines.append(
            f"pillar: a chain of {len(pillar.parts)} beams; the heights above are those of section "
            f"{pillar.highest + 1}, the highest one"
        )
    if note := pillar.form.sizing_note:
        lines.append(f"pillar: {note}")
    if pillar.fillet_m > 0.0:
        lines.append(f"pillar: the foot fillet of {1e3 * pillar.fillet_m:g} mm stiffens it but is neglected here")
    return lines
