"""Zone, rows and extension as one thin strip across the plate, its pillars as beams smeared along x: milliseconds a design.

w = Y(y) cos(k x) with the wanted wavenumber k; cubic elements over y (finite strips, cheung1976); every row is a line of
pillars that carry their own vibrations (standing_pillar). The plate's rigidity is lowered by what shear takes from the
wave that is wanted (Mindlin). Good for ranking designs: what a computed cell knows of the pillars' feet is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import ceil, pi, sqrt

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.analytic.beam_elements import hermite
from solvers.analytic.plates import Strip, mindlin_wave_hz, thin_plate_hz
from solvers.analytic.predesign import free_kx_per_m, strip_of
from solvers.errors import SolverError
from solvers.measures.confinement import Confinement, Profile, measure_profile
from solvers.measures.driven_zones import BESIDE, DrivenZones, drive_zones
from solvers.resonators.standing_pillar import (
    EffectiveMass,
    bending_effective_mass,
    lifting_effective_mass,
    root_compliance,
)

PER_WIDTH = 8  # elements across a zone's width: a wave of the zone's is 16 long, cubic ones are exact to 1e-5
_GAUSS = legendre.leggauss(4)


@dataclass(frozen=True)
class StripModes:
    """Modes even about y = 0, ascending: frequency_hz (k,) and how well each is confined."""

    frequency_hz: FloatArray
    confinement: Confinement


def strip_modes(design: Design, low_hz: float, high_hz: float, softness: float = 0.5) -> StripModes:
    """Modes with low <= f <= high, Hz. SolverError for a design without zone or thickness.

    `softness` scales how far the pillars' feet give way beyond what the strip bends there: 1 is a half-space's compliance.
    """
    frequency_hz, profile = _solved(design, (low_hz, high_hz), softness)
    return StripModes(frequency_hz, measure_profile(profile, design))


def strip_zones(
    design: Design, low_hz: float, high_hz: float, quality_factor: float, softness: float = 0.5
) -> DrivenZones:
    """Zones of a plate driven in turn at their peaks within a window, by its modes and those somewhat beyond. SolverError as
    strip_modes, and where no mode lies there.
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
    stiffness, mass = _plate(nodes, strip, kx, _rigidity(strip, kx))
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
    half, borders = (
        design.half_span_m,
        np.add.outer(design.zone_centres_m, [-design.width_m / 2.0, design.width_m / 2.0]),
    )
    ends = [0.0, design.width_m / 2.0, half] if design.zones == 1 else [-half, *borders.ravel(), half]
    fixed = np.unique(np.round([*ends, *(y for _, y in _rows(design))], 9))
    longest = design.width_m / PER_WIDTH
    panels = [np.linspace(a, b, ceil((b - a) / longest) + 1)[1:] for a, b in pairwise(fixed)]
    return np.concatenate([fixed[:1], *panels])


def _rigidity(strip: Strip, kx: float) -> float:
    """D, lowered so that the wave of the wanted shape has the frequency that shear gives it, N m."""
    wave = sqrt(kx**2 + strip.across_per_m**2)
    return strip.rigidity_n_m * (mindlin_wave_hz(strip, wave) / thin_plate_hz(strip, wave)) ** 2


def _plate(nodes: FloatArray, strip: Strip, kx: float, rigidity: float) -> tuple[FloatArray, FloatArray]:
    """K and M per length over (Y, Y') of every node.

    2 V = int D (k^4 Y^2 + Y''^2 - 2 nu k^2 Y Y'' + 2 (1 - nu) k^2 Y'^2), 2 T = int rho h Y'^2 (over time).
    """
    (value, slope, curve), weight = _shapes(nodes)
    mixed = _integral(value, curve, weight)
    bent = kx**4 * _integral(value, value, weight) + _integral(curve, curve, weight)
    bent -= strip.poisson * kx**2 * (mixed + mixed.transpose(0, 2, 1))
    bent += 2.0 * (1.0 - strip.poisson) * kx**2 * _integral(slope, slope, weight)
    heavy = strip.mass_kg_m2 * _integral(value, value, weight)
    return _assembled(rigidity * bent), _assembled(heavy)


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
    lever_m = design.thickness_m / 2.0
    bodies = {
        pillar: (
            bending_effective_mass(pillar, lever_m, softness * root_compliance(pillar)),
            lifting_effective_mass(pillar),
        )
        for pillar in design.kinds
    }
    for row, y in _rows(design):
        pillar = design.row_pillars[row]
        density = pillar.faces * len(design.column_centres(row)) / design.length_m
        turning, lifting = bodies[pillar]
        node = int(np.argmin(np.abs(nodes - y)))
        for body, dof, factor in (
            (lifting, 2 * node, 1.0),
            (turning, 2 * node + 1, 1.0),
            (turning, 2 * node, kx),
        ):
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
