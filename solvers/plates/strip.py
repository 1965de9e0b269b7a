"""A plate as one thin strip across zone, rows and margin, its pillars as beams smeared along x: milliseconds per design."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import ceil, pi

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray
from geometry.layout import Design, Pillar
from solvers.analytic.beams import Beam, hermite
from solvers.analytic.plates import Strip, mindlin_wave_hz, thin_plate_hz
from solvers.analytic.predesign import free_kx_per_m, pillar_beam, strip_of
from solvers.errors import SolverError
from solvers.measures.confinement import BESIDE, AcrossModes, DrivenZones, Profile, drive_zones, measure_profile

# -- standing pillars --------------------------------------------------------------------------------------------------
# A pillar on a moving foot: its rigid inertia and its own vibrations, to be placed on a plate.
# Foot motion d and own modes a_j (foot clamped): T = J d'^2/2 + sum L_j a_j' d' + a_j'^2/2, V = sum omega_j^2 a_j^2/2
# (Craig and Bampton, one body). Shear and rotary inertia are Timoshenko's; the section may taper.

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


def _root_compliance(pillar: Pillar) -> float:
    """Rotation of the pillar's foot in an elastic half-space per moment, rad/(N m): 16.67/(pi E a^3).

    Plane stress, for a square section of side a; another one has that of the square of equal area. Source: odonnell1960.
    """
    return ROOT / (pillar.material.rod(2).young_pa * pillar.form.section.area_m2**1.5)


def bending_effective_mass(pillar: Pillar, lever_m: float, compliance: float = 0.0) -> EffectiveMass:
    """Compute the effective mass of a pillar whose foot turns about a line below it while the pillar bends.

    Parameters
    ----------
    pillar : Pillar
        Sizes in m.
    lever_m : float
        Distance of the line below the foot: to the middle of the plate.
    compliance : float, optional
        Rotation of the foot per moment due to the plate around it, in rad/(N m).

    Returns
    -------
    EffectiveMass
        Moment of inertia in kg m^2 and its resonances.

    References
    ----------
    .. [1] craig1968 (docs/references.bib)
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
    if compliance > 0.0:  # one more coordinate: the pillar's rigid rotation against a spring at its foot
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
    """Compute the effective mass of a pillar whose foot moves along its axis while the pillar stretches.

    Parameters
    ----------
    pillar : Pillar
        Sizes in m.

    Returns
    -------
    EffectiveMass
        Mass in kg and its resonances.
    """
    beam = pillar_beam(pillar, about_x=True)
    s, weight, ratio = _rule(beam)
    shapes, slopes = _clamped(s)
    stretch = pillar.material.rod(2).young_pa * pillar.form.section.area_m2
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


# -- strip -------------------------------------------------------------------------------------------------------------
# Zone, rows and margin as one thin strip across the plate, its pillars as beams smeared along x: milliseconds per
# design.
# w = Y(y) cos(k x) with the target wavenumber k; cubic elements over y (finite strips, cheung1976); every row is a
# line of pillars that carry their own vibrations. The plate's rigidity is lowered by the effect of shear on the
# target wave (Mindlin). Good for ranking designs: the detailed deformation of the pillars' feet is missing.

PER_WIDTH = 8  # elements across a zone's width: a wave of the zone's is 16 long, cubic ones are exact to 1e-5
_GAUSS = legendre.leggauss(4)


def strip_modes(design: Design, low_hz: float, high_hz: float, softness: float = 0.5) -> AcrossModes:
    """Solve the modes of a plate as one strip, within a window.

    Parameters
    ----------
    design : Design
        The plate.
    low_hz, high_hz : float
        Ends of the window.
    softness : float, optional
        Fraction of a half-space's compliance that the pillars' feet have, in addition to the strip's own bending.

    Returns
    -------
    AcrossModes
        Frequencies and measures (k,).

    Raises
    ------
    SolverError
        If the design lacks a zone or a thickness.
    """
    frequency_hz, profile = _solved(design, (low_hz, high_hz), softness)
    return AcrossModes(frequency_hz, measure_profile(profile, design))


def strip_zones(
    design: Design, low_hz: float, high_hz: float, quality_factor: float, softness: float = 0.5
) -> DrivenZones:
    """Drive each zone of a plate at its peak within a band, with the strip's modes there and somewhat beyond.

    Parameters
    ----------
    design : Design
        The plate, lengths in m.
    low_hz, high_hz : float
        Ends of the band.
    quality_factor : float
        Of every mode, dimensionless.
    softness : float, optional
        Factor on the compliance of the pillars' feet: 1 is a half-space.

    Returns
    -------
    DrivenZones
        Frequencies in Hz and levels in dB.

    Raises
    ------
    SolverError
        For a design without zone or thickness, and if no mode lies there.
    """
    frequency_hz, profile = _solved(design, (BESIDE[0] * low_hz, BESIDE[1] * high_hz), softness)
    return drive_zones(design, frequency_hz, profile, (low_hz, high_hz), quality_factor)


def _solved(design: Design, window_hz: tuple[float, float], softness: float) -> tuple[FloatArray, Profile]:
    """Frequencies (k,) in Hz within a window and their motion: of half the plate about one zone, of all of it with several."""
    strip = strip_of(design)
    if strip is None:
        raise SolverError("a strip across the plate needs a zone and a thickness")
    kx = free_kx_per_m(design)
    nodes = _nodes(design)
    stiffness, mass = _plate(nodes, strip, kx, _lowered(strip, kx))
    if design.pillar and design.rows:
        stiffness, mass = _with_rows(stiffness, mass, nodes, design, kx, softness)
    free = np.arange(len(stiffness))
    if design.zones == 1:
        free = np.delete(free, 1)  # no slope on the plate's middle line
    square = np.ix_(free, free)
    window = [(2.0 * pi * end) ** 2 for end in window_hz]
    values, vectors = eigh(stiffness[square], mass[square], subset_by_value=window)
    full = np.zeros((len(stiffness), len(values)))
    full[free] = vectors
    return np.sqrt(values) / (2.0 * pi), _profile(nodes, full, design)


def _rows(design: Design) -> list[tuple[int, float]]:
    """Number and y of the rows on the strip: on one side of one zone, all of them with several."""
    if not design.rows:
        return []
    if design.zones == 1:
        return list(enumerate(design.row_centres()))
    return list(zip(design.row_numbers, design.row_places(), strict=True))


def _nodes(design: Design) -> FloatArray:
    """Nodes from the middle line (with several zones from the other edge) to the plate's edge, one on every row and border."""
    half = design.half_span_m
    borders = np.add.outer(design.zone_centres_m, [-design.width_m / 2.0, design.width_m / 2.0])
    ends = [0.0, design.width_m / 2.0, half] if design.zones == 1 else [-half, *borders.ravel(), half]
    fixed = np.unique(np.round([*ends, *(y for _, y in _rows(design))], 12))
    longest = design.width_m / PER_WIDTH
    panels = [np.linspace(a, b, ceil((b - a) / longest) + 1)[1:] for a, b in pairwise(fixed)]
    return np.concatenate([fixed[:1], *panels])


def _lowered(strip: Strip, kx: float) -> float:
    """Factor on the rigidity with which the wave of the target shape has the frequency that shear gives it."""
    wave = kx, strip.across_per_m
    return (mindlin_wave_hz(strip, *wave) / thin_plate_hz(strip, *wave)) ** 2


def _plate(nodes: FloatArray, strip: Strip, kx: float, share: float) -> tuple[FloatArray, FloatArray]:
    """K and M per length over (Y, Y') of every node, `share` of the rigidities counted.

    2 V = int D_11 k^4 Y^2 + D_22 Y''^2 - 2 D_12 k^2 Y Y'' + 4 D_66 k^2 Y'^2, 2 T = int rho h Y'^2 (over time).
    """
    (value, slope, curve), weight = _shapes(nodes)
    mixed, d = _integral(value, curve, weight), share * strip.stack.bending_n_m
    bent = d[0, 0] * kx**4 * _integral(value, value, weight) + d[1, 1] * _integral(curve, curve, weight)
    bent -= d[0, 1] * kx**2 * (mixed + mixed.transpose(0, 2, 1))
    bent += 4.0 * d[2, 2] * kx**2 * _integral(slope, slope, weight)
    heavy = strip.stack.mass_kg_m2 * _integral(value, value, weight)
    return _assembled(bent), _assembled(heavy)


def _shapes(nodes: FloatArray) -> tuple[list[FloatArray], FloatArray]:
    """Cubic shape functions, their slopes and curvatures at Gauss points, (elements, points, 4) each, and weights in m."""
    length = np.diff(nodes)[:, None, None]
    stretch = np.concatenate([np.ones_like(length), length] * 2, axis=2)
    return [unit * stretch / length**order for order, unit in enumerate(_unit_shapes())], length[:, 0] * _GAUSS[1] / 2.0


@cache
def _unit_shapes() -> tuple[FloatArray, ...]:
    return tuple(hermite((_GAUSS[0] + 1.0) / 2.0, 1.0, order) for order in range(3))


def _integral(left: FloatArray, right: FloatArray, weight: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("eqi,eq,eqj->eij", left, weight, right))


def _assembled(elements: FloatArray) -> FloatArray:
    """Element matrices (n, 4, 4) over neighbouring nodes, summed, (2 n + 2, 2 n + 2)."""
    out = np.zeros((2 * len(elements) + 2,) * 2)
    for e, matrix in enumerate(elements):
        out[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += matrix
    return out


def _with_rows(
    stiffness: FloatArray, mass: FloatArray, nodes: FloatArray, design: Design, kx: float, softness: float
) -> tuple[FloatArray, FloatArray]:
    """K and M with a line of pillars on every row: lift by Y, turn across by Y', turn along by k Y."""

    @cache
    def bodies(pillar: Pillar) -> tuple[EffectiveMass, EffectiveMass]:
        compliance = softness * _root_compliance(pillar)
        return bending_effective_mass(pillar, design.thickness_m / 2.0, compliance), lifting_effective_mass(pillar)

    for row, y in _rows(design):
        pillar = design.row_pillars[row]
        density = pillar.faces * len(design.column_centres(row)) / design.length_m
        turning, lifting = bodies(pillar)
        node = int(np.argmin(np.abs(nodes - y)))
        for body, dof, factor in ((lifting, 2 * node, 1.0), (turning, 2 * node + 1, 1.0), (turning, 2 * node, kx)):
            stiffness, mass = _standing(stiffness, mass, body, dof, factor, density)
    return stiffness, mass


def _standing(
    stiffness: FloatArray, mass: FloatArray, body: EffectiveMass, dof: int, factor: float, density: float
) -> tuple[FloatArray, FloatArray]:
    """`density` pillars per length whose foot moves by `factor` times an dof; their own modes are appended."""
    old, count = len(stiffness), len(body.omega)
    out = [np.zeros((old + count,) * 2) for _ in range(2)]
    for matrix, given in zip(out, (stiffness, mass), strict=True):
        matrix[:old, :old] = given
    own = np.arange(old, old + count)
    out[0][own, own] = density * body.omega**2
    out[1][own, own] = density
    out[1][dof, dof] += density * body.inertia * factor**2
    out[1][dof, own] = out[1][own, dof] = density * factor * body.coupling
    return out[0], out[1]


def _profile(nodes: FloatArray, vectors: FloatArray, design: Design) -> Profile:
    """Y of every mode at the Gauss points of the elements, and half a sine across the zone."""
    (value, _, _), weight = _shapes(nodes)
    dofs = 2 * np.arange(len(nodes) - 1)[:, None] + np.arange(4)
    moved = np.einsum("eqi,eik->eqk", value, vectors[dofs])
    y = (nodes[:-1, None] + np.diff(nodes)[:, None] * (_GAUSS[0] + 1.0) / 2.0).ravel()
    shape = np.cos(pi * design.from_zone_m(y) / design.width_m)
    return Profile(y, weight.ravel(), moved.reshape(len(y), -1), shape, 1.0)
