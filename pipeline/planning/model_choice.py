"""How each part of a scene is modelled and what is looked for in it: what a plan lists, and what computations then build."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from geometry.hex.scenes import HexSettings
from pipeline.case.limits import MIN_GAP
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.planning import mesh_rules, simplifications
from pipeline.planning.mesh_rules import MeshLevel
from pipeline.planning.simplifications import CLASSES, Simplification
from pipeline.quantity import figure, percent
from solvers.accuracy.calibration import HEX, TET, TET_ORDER
from solvers.errors import SolverError
from solvers.measures.confinement import target_symmetry
from solvers.superelement.interface import ReductionSettings

# the highest band asked for: a cell begins with fixed-interface modes below; a coarse cell tells how many more
BEYOND = 4.0
SUPERELEMENT, SOLID = "superelement", "solid"


@dataclass(frozen=True)
class ModelChoice:
    """Model and mesh of one part: the objects that the solvers then build from, not a description of them.

    hexahedra: settings of a structured mesh; edge_m: edge length of tetrahedra where the part is meshed through CAD;
    reduction: settings of the superelement, None for a solid; quarter: symmetry classes are solved one by one on a quarter.
    The mesh of a part solved as meshed makes no larger error than its calibration tells up to good_to_hz; a reduced one
    tells its own. `left_out` are the simplifications, `why`
    the reasons.
    """

    part: str
    model: str
    hexahedra: HexSettings | None
    edge_m: float | None
    reduction: ReductionSettings | None
    quarter: bool
    left_out: tuple[Simplification, ...]
    why: tuple[str, ...]
    good_to_hz: float
    mesh_level: MeshLevel | None = None  # of hexahedra

    @property
    def kind(self) -> str:
        """Whether the part is meshed by hexahedra or tetrahedra."""
        return HEX if self.edge_m is None else TET

    @property
    def classes(self) -> tuple[str | None, ...]:
        """Symmetry classes that are solved one by one; (None,) for a body that is solved whole."""
        return CLASSES if self.quarter else (None,)

    @property
    def name(self) -> str:
        """Name of the model as results print it: superelement hex3, solid tet2."""
        order = self.hexahedra.order if self.hexahedra and self.kind == HEX else TET_ORDER
        return f"{self.model} {self.kind}{order}"

    @property
    def mesh(self) -> str:
        """Describe the mesh in words."""
        if self.kind == TET:
            return f"tetrahedra of order {TET_ORDER}, {_mm(self.edge_m or 0.0)} edges"
        assert self.hexahedra
        graded = f", {self.hexahedra.layers} graded layers at singular edges" if self.hexahedra.layers else ""
        through = f", {self.hexahedra.through} through the plate" if self.hexahedra.through > 1 else ""
        return f"hexahedra of order {self.hexahedra.order}, {_mm(self.hexahedra.size_m)}{through}{graded}"


def model_choice_of(case: Case, part: str, high_hz: float) -> ModelChoice:
    """Choose model and mesh of a part for modes up to a frequency. Raises InputError for a model that cannot serve."""
    check_model(case, part == "zone" or _hexahedra(case, part))
    return _plate(case, high_hz) if part == "plate" else _lone_part(case, part, high_hz)


def _hexahedra(case: Case, part: str) -> bool:
    """Whether hexahedra serve a part, where the case asks for them by name."""
    return case.solve.mesh != HEX or simplifications.hexahedra(case, part) is not None


def check_model(case: Case, hexahedra: bool) -> None:
    """Refuse an analytic model for a computed question, and hexahedra for a shape that they cannot follow."""
    faults = []
    if case.solve.model == "analytic":
        faults.append(
            "solve.model = 'analytic': must be auto, superelement or solid here; `antinode predesign` is analytic"
        )
    if case.solve.mesh == HEX and not hexahedra:
        pillar = case.design.pillar
        what = f"a {pillar.shape} pillar{' with a fillet' if pillar.fillet_m else ''}" if pillar else "the scene"
        faults.append(f"solve.mesh = 'hex': must be auto or tet, hexahedra do not follow {what} here")
    if faults:
        raise InputError(f"{case.source or case.name}: {fault}" for fault in faults)


def _lone_part(case: Case, part: str, high_hz: float) -> ModelChoice:
    """The zone between clamped sides, or the pillar on a clamped foot, whose tetrahedra mesh it whole."""
    design, accuracy = case.design, case.solve.accuracy
    if part == "pillar":
        case.require_one_kind("the lone pillar is")
    no_cad = simplifications.hexahedra(case, part)
    quarter = simplifications.mirror_images(design, part) if no_cad or part == "zone" else None
    level, top_hz = mesh_rules.reaching(part, design, accuracy, high_hz)
    hexahedra = mesh_rules.lone_mesh(part, design, level, top_hz) if no_cad else None
    smallest_m = design.pillar.smallest_m if part == "pillar" and design.pillar else 2.0 * design.thickness_m
    edge = None if no_cad else mesh_rules.tet_edge_m(smallest_m, accuracy)
    return _choice(case, part, SOLID, level, hexahedra, edge, (no_cad, quarter), good_to_hz=top_hz)


def _plate(case: Case, high_hz: float) -> ModelChoice:
    design, accuracy = case.design, case.solve.accuracy
    bare, no_cad = simplifications.no_pillars(design, "plate"), simplifications.hexahedra(case, "plate")
    taken: tuple[Simplification | None, ...] = (bare, no_cad, simplifications.mirror_images(design, "plate"))
    if case.solve.model == SOLID:
        level = mesh_rules.whole_level(design, accuracy, high_hz)
        hexahedra = mesh_rules.cell_mesh(design, level) if no_cad else None
        edge = None if no_cad else mesh_rules.tet_plate_edge_m(design, accuracy)
        return _choice(case, "plate", SOLID, level, hexahedra, edge, taken, why="the case asks for it", table="whole")
    if design.is_staggered:
        check_stagger(case)
    reduction = mesh_rules.plate_reduction(design, accuracy, high_hz)
    edge = None if no_cad or bare else mesh_rules.tet_cell_edge_m(design, accuracy)
    why = "cells assembled cost one reduction a kind; one mesh level finer where their own estimate asks for it"
    taken = (*taken, simplifications.alike_cells(design))
    level = mesh_rules.cell_level(accuracy)
    return _choice(case, "plate", SUPERELEMENT, level, reduction.hexahedra, edge, taken, reduction, why)


def check_stagger(case: Case) -> None:
    """InputError where staggered panels, half a pitch wide, cannot hold a pillar: both kinds of rows share their lines."""
    design = case.design
    reach = max((pillar.reach_m[0] for pillar in design.kinds), default=0.0)
    if design.pitch_x_m / 2.0 < (1.0 + MIN_GAP) * reach:
        need = f"array.pitch_x_mm above {2e3 * reach:g}, twice the pillars' width, or solve.model = 'solid'"
        raise InputError(f"{case.source or case.name}: array.stagger = true: cells of half a pitch need {need}")


def cell_model_choice(case: Case, high_hz: float = 0.0) -> ModelChoice:
    """How the unit cell is modelled: reduced, or as meshed when the case asks for the solid and boxes allow it.

    high_hz: waves up to there are asked for, too, beside the lowest bands.

    Raises InputError for a model that cannot serve.
    """
    case.require_one_kind("the unit cell is")
    check_model(case, _hexahedra(case, "cell"))
    design, accuracy = case.design, case.solve.accuracy
    no_cad = simplifications.hexahedra(case, "cell")
    if design.stagger and not no_cad:
        what = "its cell takes pillars that hexahedra follow with room about them, and solve.mesh auto or hex"
        raise InputError(f"{case.source or case.name}: array.stagger = true: {what}")
    taken = (simplifications.no_pillars(design, "cell"), no_cad)
    if case.solve.model == SOLID and no_cad:
        level, settings = mesh_rules.cell_level(accuracy), mesh_rules.cell_settings(design, accuracy)
        return _choice(case, "cell", SOLID, level, settings, None, taken, why="the case asks for it")
    if design.stagger:
        check_stagger(case)
    reduction = mesh_rules.lattice_reduction(design, accuracy, _modes_end_hz(case, high_hz))
    edge = None if no_cad else mesh_rules.tet_cell_edge_m(design, accuracy)
    why, level = "one reduced pair serves every wavevector", mesh_rules.cell_level(accuracy)
    return _choice(case, "cell", SUPERELEMENT, level, reduction.hexahedra, edge, taken, reduction, why)


def _modes_end_hz(case: Case, high_hz: float) -> float:
    """No fixed-interface mode above it is worth its place; infinity where no pillar has modes below the plate's.

    Panels of staggered rows keep as many as a plate's do.
    """
    design = case.design
    if design.pillar is None:
        return inf
    from pipeline.planning.coarse_cell import coarse_cell  # solves: a plan of a plate loads no solver

    plate_hz = mesh_rules.lattice_reduction(design, case.solve.accuracy).top_hz
    try:
        end_hz = coarse_cell(design, case.bands.count).bands_end_hz(plate_hz)
    except SolverError:  # beyond what a coarse mesh can count
        return inf
    return max((mesh_rules.REACH if design.stagger else BEYOND) * end_hz, mesh_rules.REACH * high_hz)


def _choice(
    case: Case, part: str, model: str, level: MeshLevel, hexahedra: HexSettings | None, edge_m: float | None,
    taken: tuple[Simplification | None, ...], reduction: ReductionSettings | None = None, why: str = "", table: str = "",
    good_to_hz: float | None = None,
) -> ModelChoice:  # fmt: skip
    left_out = tuple(simplification for simplification in taken if simplification)
    boxes = hexahedra if edge_m is None else None
    return ModelChoice(
        part, model, hexahedra, edge_m, reduction, any(each.rule == "mirror_images" for each in left_out), left_out,
        (*([why] if why else []), *_because(case, table or part, boxes, level, reduction is not None)),
        mesh_rules.good_to_hz(part, case.design) if good_to_hz is None or not boxes else good_to_hz,
        level if boxes else None,
    )  # fmt: skip


def _because(case: Case, part: str, hexahedra: HexSettings | None, level: MeshLevel, reduced: bool) -> tuple[str, ...]:
    accuracy = f"accuracy {case.solve.accuracy:g}"
    if hexahedra:
        error = None if reduced else mesh_rules.expected_error(part, level)
        known = "" if error is None else f"{percent(error)} were measured on the calibrated design, "
        reason = f"{known}two coarser meshes tell its own error, and a finer one is taken where it misses"
        return (f"{accuracy} asks for order {hexahedra.order} with {hexahedra.layers} graded layers: {reason}",)
    shape = "the case asks for tetrahedra" if case.solve.mesh == TET else "hexahedra do not follow the pillar"
    return (shape, f"{accuracy} sets their edges, and shorter ones are taken where their stresses tell that it misses")


def _mm(length_m: float) -> str:
    return f"{figure(1e3 * length_m)} mm"


DEFAULT_COUNT = 20
SIGNS = {"SS": "++", "SA": "+-", "AS": "-+", "AA": "--"}  # u_z symmetric or antisymmetric, x then y: as signs
MEASURED = ("plate", "zone")  # parts whose touch face tells which mode is the target mode


@dataclass(frozen=True)
class Expected:
    """The target mode as another model has it: its frequency and its strength in the target shape."""

    frequency_hz: float
    strength: float


@dataclass(frozen=True)
class Request:
    """What to solve: a band, or `count` modes near a frequency (0: the lowest); one symmetry class or all.

    search: look for the target mode in its own window, beyond what is asked for; else among the modes found alone.
    expected: look for it in the band asked for, which is widened only while it holds no mode as strong as that one.
    """

    part: str = "plate"
    band_hz: tuple[float, float] | None = None
    near_hz: float | None = None
    count: int | None = None
    symmetry: str | None = None
    search: bool = True
    expected: Expected | None = None

    @property
    def highest_hz(self) -> float | None:
        """Up to where a model has to be good, Hz; None where the request does not say."""
        return self.band_hz[1] if self.band_hz else 2.0 * (self.near_hz or 0.0) or None


def with_defaults(case: Case, request: Request) -> Request:
    """Complete a request by the case, then by pre-design."""
    solve, query = case.solve, request
    if query.band_hz is None and query.near_hz is None and query.count is None:
        query = replace(query, band_hz=solve.band_hz, near_hz=solve.near_hz, count=solve.count)
    if query.band_hz is not None:
        return query
    if query.near_hz is not None:
        return replace(query, count=query.count or solve.count or DEFAULT_COUNT)
    if query.count is not None:
        return replace(query, near_hz=0.0)
    if query.part == "pillar":
        return replace(query, near_hz=0.0, count=4)
    target = case.target_symmetry if query.part == "plate" else target_symmetry(case.design.nodal_lines)
    return replace(query, band_hz=mesh_rules.target_window_hz(case.design), symmetry=query.symmetry or target)


def of_case(case: Case) -> Request:
    """Request of a study for the plate's modes: the case's window and the target mode's in one, of the target mode's
    class.
    """
    solve = case.solve
    return with_search(case, Request("plate", solve.band_hz, solve.near_hz, solve.count, case.target_symmetry))


def target_window_hz(case: Case, query: Request) -> tuple[float, float] | None:
    """Window in which the target mode is searched first; None for parts and symmetry classes that have none."""
    own = query.part in MEASURED and query.symmetry in (None, target_symmetry(case.design.nodal_lines))
    return mesh_rules.search_window_hz(case.design) if own else None


def model_high_hz(case: Case, query: Request) -> float:
    """Highest frequency, Hz, for which the model has to be good: the request's, and the target mode's window where
    they meet.
    """
    high = query.highest_hz or mesh_rules.target_window_hz(case.design)[1]
    window = target_window_hz(case, query) if query.search else None
    meets = window and window[0] <= high and (query.band_hz is None or query.band_hz[0] <= window[1])
    return max(high, window[1]) if window and meets else high


def response_high_hz(case: Case, band_hz: tuple[float, float]) -> float:
    """Highest frequency, Hz, for which the plate of a response has to be good: that of its modes in the same band, so that
    both are assembled from the same reduced panels.
    """
    return model_high_hz(case, Request("plate", band_hz))


def with_search(case: Case, query: Request) -> Request:
    """Widen the request's band by the target mode's window where they meet."""
    window = target_window_hz(case, query) if query.search else None
    band = query.band_hz
    if not window or not band or band[0] > window[1] or window[0] > band[1]:
        return query
    return replace(query, band_hz=(min(band[0], window[0]), max(band[1], window[1])))


def driven_band_hz(case: Case, band_hz: tuple[float, float] | None) -> tuple[float, float]:
    """Band of a response or an attenuation: the given one, else the case's, else about the target mode."""
    return band_hz or case.solve.band_hz or mesh_rules.target_window_hz(case.design)
