"""Rules that choose the mesh, the degrees and the frequency window of a scene, each with its reason.

`accuracy` selects the cheapest mesh that meets it according to the calibration.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from math import ceil, hypot, inf, pi, prod, sqrt

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, half_wavelength_m
from solvers.accuracy import calibration
from solvers.accuracy.calibration import MeshLevel
from solvers.analytic.beams import roots
from solvers.analytic.layered import sheared
from solvers.analytic.plates import MAX_LINES, Strip, levy_hz, mindlin_mode, thin_plate_hz
from solvers.analytic.predesign import pillar_frequencies_hz, strip_of
from solvers.superelement.interface import Interface, ReductionSettings

WINDOW = (0.72, 1.35)  # of the exact thin-plate frequency: range of the target modes found in plates with pillars
# degree along a side by accuracy: longest side over the spacing of nodal lines; the estimate of each solve checks it
ALONG = {0.002: {4: 0.36, 5: 0.9}, 0.0: {4: 0.3, 5: 0.4}}
ACROSS = 2.05  # elements over the zone's width, a little more than two: two in each half
# thicknesses: longest element of the zone, about as in the calibration; longer ones lock
MAX_LENGTH = 5.0
# of the length that waves allow: shortest element, however thin the zone; its error does not exceed those measured
LOCKED = 0.5
ELEMENT = 0.26  # of a shear wavelength: element of a cell at the tenth band of the calibrated one
REACH = 9.0  # cut-off of a plate's fixed-interface modes over the highest frequency searched, at 1 % accuracy
SHORT_REACH = 4.0  # this factor above the first thickness-shear resonance, where waves are short in every direction
# degree through the thickness: least, greatest, and the further degrees that estimate the error of omitting them
THROUGH, MAX_THROUGH, FURTHER = 3, 8, 2
LAYERED = 1  # further degree of a plate of several layers, whose own degree is always in doubt
# of the first thickness-shear resonance: below it, further degrees matter less than a tenth as much as the discarded
# fixed-interface modes
THIN_TO = 0.25
# of the thickness: feet this close to the sides of their panels strain those through the thickness, a field that falls as
# exp(-pi room / t) for any wave; degree 3 missed 0.13 % of a frequency at 0.1, 0.03 % at 0.25, 0.02 % at 0.4
TIGHT = 0.35
SEEN = 1.0 / 3.0  # frequency error over the energy that polynomials miss of a shear wave across the plate
ALONG_LEFT = 0.015  # of the accuracy: error that a coarse cell allows such waves along its sides
MAX_ALONG = 9  # the highest degree along them
FINER = 0.3  # the cut-off goes as accuracy^-FINER; one that is too low for a cell is detected and raised
TETRAHEDRA = {0.03: 2.0, 0.01: 3.0, 0.003: 4.0}  # accuracy: elements across the smallest dimension
# ordered by degrees of freedom; an assembled plate is meshed like its cell; the grading of a whole one would run across it
MESH_LEVELS = {
    "zone": (
        MeshLevel(3, 1, 0.1), MeshLevel(3, 1, 0.1, 0.8), MeshLevel(3, 1, 0.1, 0.6), MeshLevel(3, 1, 0.1, 0.5),
        MeshLevel(4, 1, 0.1, 0.9), MeshLevel(4, 2, 0.15, 0.8),
    ),
    "pillar": (
        MeshLevel(3, 1, 0.1),
        MeshLevel(4, 1, 0.1),
        MeshLevel(4, 2, 0.15),
        MeshLevel(4, 3, 0.15),
    ),
    "cell": (
        MeshLevel(3, 1, 0.1), MeshLevel(3, 1, 0.12, 0.7, 2), MeshLevel(3, 2, 0.2), MeshLevel(3, 2, 0.2, 0.7, 2),
        MeshLevel(4, 2, 0.15), MeshLevel(4, 3, 0.15),
    ),
    "whole": (MeshLevel(3, 0, 0.1), MeshLevel(4, 0, 0.1), MeshLevel(3, 1, 0.1), MeshLevel(3, 1, 0.12, 0.45)),
}  # fmt: skip
# first mesh level of a reduced cell, which estimates its discretisation error from coarser meshes and is refined if needed
CELL_LEVELS = {0.001: MeshLevel(3, 1, 0.15), 0.0007: MeshLevel(3, 1, 0.15, 1.0, 2), 0.0: MeshLevel(4, 2, 0.15)}
# thickest element of order 3 beneath a foot, in widths of the foot: the field at its rim reaches half a width, and cells
# with thicker plates had twice the error; at most MAX_BENEATH elements for it, whatever the foot
STOUT, MAX_BENEATH = 1.2, 3
HIGHEST = 4  # order of hexahedra
COARSEST = 3  # lowest order of a cell's elements
FINEST = 24  # least number of intervals per segment for following branches and searching gaps
BENEATH_MASSES = 8.0  # elements of order 4 across a bare cell that carries masses or springs
PLATE_ACCURACY = 0.03  # a whole plate of tetrahedra as a cross-check, not as the result
PLATE_TETRAHEDRA = 2.0  # across its smallest dimension then: 1.9 % too high; 1.4, 3.2 % too high, lose the confinement
NEAR_COUNT = 16


def cell_level(accuracy: float) -> MeshLevel:
    """First mesh level of a reduced cell or an assembled plate for an accuracy."""
    return next(level for limit, level in CELL_LEVELS.items() if accuracy >= limit)


def finer_cell_level(level: MeshLevel) -> MeshLevel | None:
    """Next mesh level of a reduced cell; None after the finest."""
    return _after(level, tuple(CELL_LEVELS.values()))


def finer_level(part: str, level: MeshLevel) -> MeshLevel | None:
    """Next mesh level of a part solved without reduction; None after the finest."""
    return _after(level, mesh_levels(part))


def _after(level: MeshLevel, levels: tuple[MeshLevel, ...]) -> MeshLevel | None:
    return next((finer for own, finer in pairwise(levels) if own == level), None)


def mesh_levels(part: str) -> tuple[MeshLevel, ...]:
    """Mesh levels of a part solved without reduction: zone, pillar, cell, or the whole plate."""
    return MESH_LEVELS[part]


def mesh_level(part: str, accuracy: float) -> MeshLevel:
    """Cheapest mesh level expected to meet the accuracy on a part; the finest if none is."""
    for row in mesh_levels(part):
        expected = expected_error(part, row)
        if expected is not None and expected <= accuracy:
            return row
    return mesh_levels(part)[-1]


def reaching(part: str, design: Design, accuracy: float, high_hz: float) -> tuple[MeshLevel, float]:
    """Cheapest mesh level expected to meet the accuracy for modes of an isolated part, and the highest frequency it serves.

    If every mesh level misses the accuracy above the calibrated frequencies, the elements shrink with the waves.
    """
    good = good_to_hz(part, design)
    growth = max(1.0, high_hz / good)
    for row in mesh_levels(part):
        expected = expected_error(part, row, growth)
        if expected is not None and expected <= accuracy:
            return row, good
    return mesh_level(part, accuracy), max(good, high_hz)


def expected_error(part: str, row: MeshLevel, growth: float = 1.0) -> float | None:
    """Expected error of a mesh level at `growth` times the calibrated frequencies; None without a measurement."""
    return calibration.by_hexahedra(part, row, calibration.PLATE if part == "whole" else calibration.HEX, growth)


def good_to_hz(part: str, design: Design) -> float:
    """Highest calibrated frequency of a part, Hz: target mode of a zone, third bending of a pillar, tenth band of a cell."""
    if part == "zone":
        return _target_hz(design)
    if part == "pillar":
        assert design.pillar
        return float(pillar_frequencies_hz(design.pillar, "timoshenko", 3)[-1])
    size = 2.0 * design.thickness_m
    if design.pillar:
        size = min(size, design.pitch_x_m / 2.0, design.pitch_y_m / 2.0)
    return ELEMENT * design.stack.mean.shear_m_s / size


def whole_level(design: Design, accuracy: float, high_hz: float) -> MeshLevel:
    """Mesh level of a plate meshed whole.

    Without feet, its elements have the highest order and at most half a shear wavelength; two lower orders estimate their
    error.
    """
    level = mesh_level("whole", accuracy)
    if design.pillar:
        return level
    level = MeshLevel(HIGHEST, 0, level.factor)
    if high_hz <= 0.0:
        return level
    longest = design.stack.mean.shear_m_s / high_hz / 2.0
    return replace(level, share=min(level.share, longest / (2.0 * design.thickness_m)))


def zone_mesh(design: Design, row: MeshLevel, high_hz: float = 0.0) -> HexSettings:
    """Elements of the bare strip for modes up to a frequency; its clamped faces end in singular edges."""
    longest = min(design.line_spacing_m * 2.0 / 3.0, design.width_m / ACROSS)
    size = min(longest, max(MAX_LENGTH * design.thickness_m, LOCKED * longest))
    return _settings(row, size * _shrunk("zone", design, high_hz))


def pillar_mesh(design: Design, row: MeshLevel, high_hz: float = 0.0) -> HexSettings:
    """Elements of the isolated pillar up to a frequency: two across the section, graded towards the clamped foot."""
    assert design.pillar
    shrunk = _shrunk("pillar", design, high_hz)
    along = row.share * shrunk * _along(design)
    return HexSettings(row.order, shrunk * design.pillar.base_m, row.layers, row.factor, along)


def lone_mesh(part: str, design: Design, row: MeshLevel, high_hz: float = 0.0) -> HexSettings:
    """Elements of the isolated zone or pillar for modes up to a frequency."""
    return (zone_mesh if part == "zone" else pillar_mesh)(design, row, high_hz)


def _shrunk(part: str, design: Design, high_hz: float) -> float:
    """Factor on the element size: a bending wavelength falls as one over the root of its frequency."""
    return min(1.0, sqrt(good_to_hz(part, design) / high_hz)) if high_hz > 0.0 else 1.0


def cell_mesh(design: Design, row: MeshLevel) -> HexSettings:
    """Elements of plate and cells: two thicknesses wide, at most about a foot's width thick, graded towards the feet."""
    mesh = _settings(row, 2.0 * design.thickness_m, _along(design) if design.pillar else None)
    if not design.pillar or row.order > COARSEST:
        return mesh
    foot = min(pillar.base_m for pillar in design.kinds)
    least = min(ceil(design.thickness_m / (STOUT * foot)), MAX_BENEATH)
    return replace(mesh, through=row.through + least - 1)


def with_nodes_for(face: Interface, mesh: HexSettings) -> HexSettings:
    """Mesh of a cell with a node through the plate for each degree, also without its layers and at one order less."""
    if face.through <= COARSEST:
        return mesh
    plain, lower = ceil(face.through / mesh.order), ceil(face.through / (mesh.order - 1)) - bool(mesh.layers)
    return replace(mesh, through=max(mesh.through, 2, plain, lower))


def cell_settings(design: Design, accuracy: float) -> HexSettings:
    """Hexahedra of a cell solved without reduction, for an accuracy."""
    return cell_mesh(design, cell_level(accuracy))


def _settings(row: MeshLevel, size_m: float, along_m: float | None = None) -> HexSettings:
    return HexSettings(row.order, row.share * size_m, row.layers, row.factor, along_m, row.through)


def _along(design: Design) -> float:
    """Element length along a pillar, m: four elements resolve its third bending, among the lowest bands if it is slender."""
    return min(min(pillar.base_m, pillar.parts[pillar.highest].height_m / 4.0) for pillar in design.kinds)


def is_tight(design: Design) -> bool:
    """Whether feet are so close to the sides of their panels that these strain through the thickness."""
    return design.foot_room_m < TIGHT * design.thickness_m


def shear_cutoff_hz(design: Design) -> float:
    """First thickness-shear resonance, Hz, above which plate theory does not hold: c_t / (2 h) of one layer."""
    return design.stack.shear_cutoff_hz


def lattice_reduction(design: Design, accuracy: float, most_hz: float = inf) -> ReductionSettings:
    """First reduction settings of the unit cell for its lowest bands; a coarse cell refines them to the accuracy.

    most_hz: upper limit of the first cut-off, for slow pillars with many modes that the requested bands do not need.
    """
    longest = max(design.pitch_x_m, design.pitch_y_m, *_leaning_m(design))
    top = 1.5 * shear_cutoff_hz(design) * 2.0 * design.thickness_m / max(2.0 * design.thickness_m, longest)
    top = min(top, most_hz) * _finer(accuracy)
    tight = design.stagger and is_tight(design)  # cells in line try further degrees on a coarse mesh
    along = 4 if longest <= 2.5 * design.thickness_m and not tight else 6
    mesh = cell_mesh(design, cell_level(accuracy))
    face = Interface(along, _least_through(design), design.stack.joints)
    size = longest / BENEATH_MASSES if design.attached else None  # a bare cell is meshed whole then
    reduction = ReductionSettings(face, top, mesh, bare_size_m=size, further=FURTHER if tight else 0)
    return replace(reduction, hexahedra=with_nodes_for(reduction.ample, mesh))


def plate_reduction(design: Design, accuracy: float, high_hz: float) -> ReductionSettings:
    """Reduction settings of a plate's panels for modes up to a frequency, Hz.

    They include further degrees through the thickness if the plate is not thin for these waves, or if feet are close to the
    sides of their panels. Bare panels are at most one shear wavelength long, and their elements half of one.
    """
    sides = (design.pitch_x_m, *design.row_pitches_m, *_leaning_m(design))
    longest = max(sides) if design.rows else 3.0 * design.thickness_m
    share = longest / design.line_spacing_m
    limits = next(each for least, each in ALONG.items() if accuracy >= least)
    along = next((degree for degree, limit in limits.items() if share <= limit), 6)
    face = Interface(along, degree_through(design, accuracy, high_hz), design.stack.joints)
    thick = high_hz >= THIN_TO * shear_cutoff_hz(design) or is_tight(design)
    further = LAYERED if face.joints else FURTHER if thick else 0
    mesh = cell_mesh(design, cell_level(accuracy))
    wave_m = design.stack.mean.shear_m_s / high_hz if high_hz > 0.0 else inf
    bare_m = 3.0 * design.thickness_m
    if design.larger_m:  # most of it is bare: panels as long as the degree along their sides allows
        bare_m = max(bare_m, limits.get(along, 0.0) * design.line_spacing_m)
    longest = min(bare_m, wave_m)
    size = min(bare_size_m(design, mesh.order) or inf, wave_m / 2.0)
    reduction = ReductionSettings(face, cutoff_to_hz(design, accuracy, high_hz), mesh, longest, size, further)
    return replace(reduction, hexahedra=with_nodes_for(reduction.ample, mesh))


def _leaning_m(design: Design) -> list[float]:
    """Lengths of the sides of an oblique cell, m; none of a rectangle."""
    return [hypot(*side) for side in design.oblique_m or ()]


def cutoff_to_hz(design: Design, accuracy: float, high_hz: float) -> float:
    """Cut-off of the fixed-interface modes of a plate's panels, Hz, for modes up to a frequency.

    A finer accuracy raises it while the plate is thin, because such panels have few of these modes.
    """
    shear_hz = shear_cutoff_hz(design)
    thin = _finer(accuracy) * min(high_hz, THIN_TO * shear_hz)
    return max(REACH * max(thin, min(high_hz, shear_hz)), SHORT_REACH * high_hz)


def _finer(accuracy: float) -> float:
    """Cut-off of the fixed-interface modes over that at 1 % accuracy."""
    return float((0.01 / min(accuracy, 0.01)) ** FINER)


def degree_through(design: Design, accuracy: float, high_hz: float) -> int:
    """Degree through the thickness that resolves a shear wave across it at a frequency, Hz; each solve's estimate checks it."""
    if design.layers:
        phase = pi * high_hz * max(layer.thickness_m / layer.material.shear_m_s for layer in design.layers)
    else:
        phase = pi / 2.0 * high_hz / shear_cutoff_hz(design)
    return degree_of(phase, accuracy / SEEN, _least_through(design), MAX_THROUGH)


def _least_through(design: Design) -> int:
    """Least degree through the thickness: of each layer, if there are several, one less."""
    return THROUGH - 1 if design.layers else THROUGH


def degree_along(design: Design, accuracy: float, high_hz: float, least: int) -> int:
    """Degree along a cell's longer side that resolves shear waves at a frequency, Hz, at least `least`."""
    phase = pi / 2.0 * high_hz / shear_cutoff_hz(design) * max(design.lattice.cell_m) / design.thickness_m
    return degree_of(phase, ALONG_LEFT * accuracy, least, MAX_ALONG)


def degree_of(phase: float, missed: float, least: int, most: int) -> int:
    """Lowest degree from `least` to `most` whose polynomials miss at most `missed` of the energy of exp(i x s) on [-1, 1].

    Degree n has (2n + 1) j_n(x)^2 of it, j_n the spherical Bessel function, at most x^n / (2n + 1)!!.
    """

    def energy(degree: int) -> float:
        return (2 * degree + 1) * (phase**degree / prod(range(1, 2 * degree + 2, 2))) ** 2

    return next((n for n in range(least, most) if energy(n + 1) <= missed), most)


def bare_size_m(design: Design, order: int) -> float | None:
    """Element size, m, of panels without a pillar, which have no singular edges: order 3 resolves the wave."""
    return 2.0 * design.thickness_m if order > 2 else None


def tet_edge_m(smallest_m: float, accuracy: float) -> float:
    """Edge length of tetrahedra from the smallest dimension of the part."""
    across = next((n for limit, n in TETRAHEDRA.items() if accuracy >= limit), 5.0)
    return smallest_m / across


def tet_cell_edge_m(design: Design, accuracy: float) -> float:
    """Edge length, m, in a unit cell or in a panel with its pillar."""
    return tet_edge_m(_smallest_m(design), accuracy)


def tet_plate_edge_m(design: Design, accuracy: float) -> float:
    """Edge length, m, in a plate meshed whole; an accuracy finer than 1 % costs too much there.

    The estimate of a plate of a file shortens its edges where needed.
    """
    if design.outline:
        return _smallest_m(design) if design.rows else design.thickness_m
    smallest = _smallest_m(design) if design.rows else design.thickness_m
    return smallest / PLATE_TETRAHEDRA if accuracy >= PLATE_ACCURACY else tet_edge_m(smallest, max(accuracy, 0.01))


def _smallest_m(design: Design) -> float:
    return min((design.thickness_m, *(pillar.smallest_m for pillar in design.kinds)))


def target_window_hz(design: Design) -> tuple[float, float]:
    """First search window of the target mode, Hz, around the zone's exact thin-plate frequency between pinned sides.

    It reaches at least the frequency between clamped sides, which rows of pillars cannot exceed.
    """
    estimate = _target_hz(design)
    return WINDOW[0] * estimate, max(WINDOW[1] * estimate, clamped_hz(design))


def search_window_hz(design: Design) -> tuple[float, float]:
    """Search window of a plate's target mode, Hz: the target window, extended down to the zone's shape that is rigid across.

    Slower motion does not bend across the zone, even if it resembles half a sine.
    """
    low, high = target_window_hz(design)
    if design.half_wavelength_m is None:  # its shape is rigid along: rigid across, it would not bend at all
        return low, high
    strip = _strip(design)
    return min(low, _target_hz(design) - thin_plate_hz(strip, 0.0, strip.across_per_m)), high


def clamped_hz(design: Design) -> float:
    """Frequency of the zone between clamped sides, Hz, with shear unless it is rigid along x; 0 for an unknown shape."""
    return _clamped_hz(_strip(design), design.nodal_lines)


@lru_cache(maxsize=64)
def _clamped_hz(strip: Strip, lines: int) -> float:
    if half_wavelength_m(strip.length_m, lines, strip.held) is None:  # a clamped beam bends across the zone
        return thin_plate_hz(strip, 0.0, roots("clamped", "clamped", 1)[0] / strip.width_m)
    return mindlin_mode(strip, lines, "clamped").frequency_hz if strip.doubled(lines)[1] <= MAX_LINES else 0.0


def _target_hz(design: Design) -> float:
    """Exact thin-plate frequency of the zone, Hz; of several layers with the shear of the wave that it is made of."""
    strip = _strip(design)
    if design.half_wavelength_m is None:  # a rigid shape along x: cylindrical bending across the zone
        return thin_plate_hz(strip, 0.0, strip.across_per_m) * sheared(strip, 0.0, strip.across_per_m)
    along = pi / (design.half_wavelength_m or inf)
    return levy_hz(strip, design.nodal_lines) * sheared(strip, along, strip.across_per_m)


def _strip(design: Design) -> Strip:
    strip = strip_of(design)
    assert strip
    return strip


def refinement_of(points: int) -> int:
    """Return the factor by which a path's intervals are refined to follow branches."""
    return -(-FINEST // points)
