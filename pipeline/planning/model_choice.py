"""Model and mesh of each part of a scene, and the request for its modes: a plan lists them, computations build from them.

The coarse cell has one element of order 3 through the plate; its pillar is a box as wide as the foot. Its frequencies lie
above those of finer meshes, so it gives an upper limit for the requested bands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, inf, sqrt
from typing import TYPE_CHECKING

from geometry.hex.boxes import cell_boxes, hex_mesh
from geometry.hex.oblique import fits
from geometry.hex.panels import square_of
from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice, Vectors, labels_of, row_vectors, shortest_vectors
from geometry.layout import Design, region_materials
from pipeline.case.attached import image_in
from pipeline.case.limits import MIN_GAP
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.planning import mesh_rules, simplifications
from pipeline.planning.simplifications import CLASSES, Simplification
from pipeline.quantity import KHZ, MM, figure, percent, several
from solvers.accuracy.calibration import HEX, TET, TET_ORDER, MeshLevel
from solvers.errors import SolverError
from solvers.measures.confinement import target_symmetry
from solvers.superelement.interface import ReductionSettings

if TYPE_CHECKING:
    from solvers.fem.assembly import System

ORDER = 3
STEP = 1.2  # factor within which the highest band is found
MANY = 4  # elements along the longer pitch, for a plate that is thin compared with it
SLENDER = 4.0  # shortest element along the pillar, in widths of its foot
FEW = 25  # bands that one element of a stub can represent
RESOLVED = 1.0 / 16.0  # of the coarse cell's degrees of freedom: further modes are too short for its elements
HALF_WAVES = 3.0  # bands per half-wave along a pillar: two bending modes, one of torsion or longitudinal

# first cut-off of a cell's fixed-interface modes over the highest requested band; a coarse cell may raise it
BEYOND = 4.0
# of the accuracy: change of a frequency that functions left out of bare panels may cause, each wave alone
SPARED = 0.005

SUPERELEMENT, SOLID = "superelement", "solid"
DEFAULT_COUNT = 20
SIGNS = {"SS": "++", "SA": "+-", "AS": "-+", "AA": "--"}  # u_z symmetric or antisymmetric, x then y: as signs
MEASURED = ("plate", "zone")  # parts with a touch face, which identifies the target mode


@lru_cache(maxsize=1)  # a cell's matrices take tens of MB; what was counted with them is kept by their CoarseCell
def _coarse_system(design: Design, count: int) -> System:
    from solvers.fem.assembly import assemble  # slow to import, and needed for plans with bands only

    settings = coarse_settings(design, count)
    settings = replace(settings, size_m=max(settings.size_m, max(design.lattice.cell_m) / MANY))
    mesh = hex_mesh(cell_boxes(design, settings), settings.order)
    return assemble(mesh, region_materials(design.stack, design.pillar))


class CoarseCell:
    """A coarse mesh of a design's unit cell, solved for its `count` lowest bands; an oblique one is a rectangle of its area."""

    def __init__(self, design: Design, count: int) -> None:
        box = square_of(design.pillar) if design.pillar else None
        if design.oblique_m:
            design = replace(design, pitch_y_m=design.lattice.area_m2 / design.pitch_x_m, oblique_m=None)
        self.design, self.count = replace(design, pillar=box), count
        self._ends_hz: dict[float, float] = {}
        self._fixed: dict[float, int] = {}

    @property
    def _system(self) -> System:
        return _coarse_system(self.design, self.count)

    def bands_end_hz(self, below_hz: float) -> float:
        """Upper limit of the requested bands at the zone's corner, Hz, within STEP; at most below_hz.

        Found by bisection of inertia counts; the first guess assumes a count that goes as the frequency squared.
        """
        if below_hz not in self._ends_hz:  # another limit's end would make an answer depend on what was asked before
            self._ends_hz[below_hz] = self._bisected_hz(below_hz)
        return self._ends_hz[below_hz]

    def resolves(self, modes: float) -> bool:
        """Whether the elements resolve this number of modes."""
        return modes <= RESOLVED * self._system.mesh.dof

    def fixed_modes(self, below_hz: float) -> int:
        """Number of modes below a frequency, Hz, of the cell with its four sides clamped."""
        if below_hz not in self._fixed:
            from solvers.fem.eigen import count_below
            from solvers.fem.solid import constrain, free_mask

            sides = free_mask(self._system.mesh, ("x-", "x+", "y-", "y+"), {})
            self._fixed[below_hz] = count_below(constrain(self._system, sides), below_hz)
        return self._fixed[below_hz]

    def _bisected_hz(self, below_hz: float) -> float:
        from solvers.fem.eigen import count_below
        from solvers.fem.factor import Factoriser
        from solvers.waves.bloch import BlochCell

        # at the zone's corner all phases are real and every band counts once
        corner_per_m = self.design.lattice.reciprocal_per_m.sum(axis=0) / 2.0
        waves, _ = BlochCell(self._system, self.design.lattice).pencil(corner_per_m)
        factorise = Factoriser()  # one symbolic analysis for all counts
        low, high, found = 0.0, below_hz, count_below(waves, below_hz, factorise)
        while found >= self.count and high > STEP * low:
            middle = sqrt(low * high) if low else high * sqrt(self.count / found) / STEP
            number = count_below(waves, middle, factorise)
            if number >= self.count:
                high, found = middle, number
            else:
                low = middle
        return high


@dataclass(frozen=True)
class ModelChoice:
    """Model and mesh of one part, as the objects from which the solvers build.

    hexahedra: settings of a structured mesh; edge_m: edge length of tetrahedra if the part is meshed through CAD;
    reduction: settings of the superelement, None for a solid; quarter: symmetry classes are solved one by one on a quarter;
    left_out: simplifications; why: reasons; good_to_hz: frequency up to which the calibration covers a part solved without
    reduction. A reduced part estimates its own error.
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
        graded = (
            f", {several(self.hexahedra.layers, 'graded layer')} at singular edges" if self.hexahedra.layers else ""
        )
        through = f", {self.hexahedra.through} through the plate" if self.hexahedra.through > 1 else ""
        return f"hexahedra of order {self.hexahedra.order}, {_mm(self.hexahedra.size_m)}{through}{graded}"


@dataclass(frozen=True)
class Expected:
    """Target mode of another model: its frequency and its effective-mass fraction in the target shape."""

    frequency_hz: float
    strength: float


@dataclass(frozen=True)
class Request:
    """Request for modes: a band, or `count` modes near a frequency (0: the lowest); one symmetry class or all.

    search: look for the target mode in its own window, too, instead of only among the modes requested.
    expected: look for it in the requested band, which is widened only until it holds a mode as strong as this one.
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
        """Highest frequency that the model has to resolve, Hz; None if the request does not fix it."""
        return self.band_hz[1] if self.band_hz else 2.0 * (self.near_hz or 0.0) or None


def coarse_settings(design: Design, count: int, through: int = 1) -> HexSettings:
    """Elements of the coarse cell for its lowest bands; along a slender pillar they are at most a half-wave long."""
    size_m, pillar, parts = 2.0 * design.thickness_m, design.pillar, ceil(sqrt(count / FEW))
    if pillar is None:
        return HexSettings(ORDER, size_m, 0, through=through)
    size_m = min(size_m, pillar.base_m / parts) if parts > 1 else size_m
    along = min(pillar.top_m / parts, max(SLENDER * pillar.base_m, HALF_WAVES * pillar.top_m / count))
    return HexSettings(ORDER, size_m, 0, pillar_size_m=along, through=through)


@lru_cache(maxsize=64)
def coarse_cell(design: Design, count: int) -> CoarseCell:
    """Coarse cell of a design for its lowest bands."""
    return CoarseCell(design, count)


def model_choice_of(case: Case, part: str, high_hz: float) -> ModelChoice:
    """Choose model and mesh of a part for modes up to a frequency; InputError for an unsuitable model."""
    check_model(case, part == "zone" or _hexahedra(case, part))
    return _plate(case, high_hz) if part == "plate" else _lone_part(case, part, high_hz)


def bands_end_hz(case: Case) -> float:
    """Upper limit of the requested bands of a case's cell, Hz, by its coarse cell; at most the cut-off of a plate's panels."""
    below_hz = mesh_rules.lattice_reduction(case.design, case.solve.accuracy).top_hz
    return coarse_cell(case.design, case.bands.count).bands_end_hz(below_hz)


def check_model(case: Case, hexahedra: bool) -> None:
    """Reject an analytic model for a computed question, and hexahedra for a shape that they cannot follow."""
    faults = []
    if case.solve.model == "analytic":
        faults.append(
            "solve.model = 'analytic': must be auto, superelement or solid here; for theory use `antinode predesign`"
        )
    if case.solve.mesh == HEX and not hexahedra:
        pillar = case.design.pillar
        what = f"a {pillar.shape} pillar{' with a fillet' if pillar.fillet_m else ''}" if pillar else "this scene"
        what = "the outline of plate.file" if case.design.outline else what
        faults.append(f"solve.mesh = 'hex': must be auto or tet; hexahedra cannot follow {what}")
    if faults:
        raise InputError(f"{case.source or case.name}: {fault}" for fault in faults)


def by_vectors(case: Case) -> Case:
    """Return the case with an oblique cell in the place of panels half a pitch wide that cannot hold what is on it.

    Parameters
    ----------
    case : Case
        Any case.

    Returns
    -------
    Case
        The case itself unless its rows are shifted, and its pillars too wide for such panels or masses attached to its cell.
    """
    return in_vectors(case, shortest_vectors(*case.design.lattice.vectors_m)) if _is_in_one_cell(case) else case


def by_rows(case: Case) -> Case:
    """Return the case with the oblique cell of one row along x, where its own is oblique or panels cannot hold it.

    Parameters
    ----------
    case : Case
        A case whose lattice has rows along x.

    Returns
    -------
    Case
        The case itself unless its lattice is oblique, or as for `by_vectors`; its pitches are those along a row and from row to
        row.

    Raises
    ------
    InputError
        For an oblique lattice without rows along x.
    """
    vectors = row_vectors(*case.design.lattice.vectors_m)
    if case.design.oblique_m and vectors is None:
        one, two = ("[{:g}, {:g}]".format(*(each / MM for each in vector)) for vector in case.design.oblique_m)
        raise InputError(
            f"array.a1_mm: the lattice of {one} and {two} mm has no rows along x: turn its vectors until it has"
        )
    if not vectors or not (case.design.oblique_m or _is_in_one_cell(case)):
        return case
    return in_rows(case, vectors)


def in_rows(case: Case, vectors: Vectors) -> Case:
    """Return the case with a cell of its lattice whose first side lies along x, and with the pitches of such rows.

    Parameters
    ----------
    case : Case
        Any case.
    vectors : tuple of tuple
        Vectors along a row and to the next one, as of `in_vectors`.

    Returns
    -------
    Case
        With what is attached to the cell at its images there.
    """
    own = in_vectors(case, vectors)
    return replace(own, design=replace(own.design, pitch_x_m=vectors[0][0], pitch_y_m=vectors[1][1]))


def in_vectors(case: Case, vectors: Vectors) -> Case:
    """Return the case with another cell of its lattice.

    Parameters
    ----------
    case : Case
        Any case.
    vectors : tuple of tuple
        Vectors (x, y) along the sides of the cell in m.

    Returns
    -------
    Case
        With what is attached to the cell at its images there.

    Raises
    ------
    InputError
        For a disc that crosses a side of the cell.
    """
    attached = tuple(replace(each, at_m=image_in(vectors, each)) for each in case.design.attached)
    own, path = Lattice(*vectors), case.bands.path
    if not {*labels_of(path)} <= {*own.high_symmetry}:
        path = own.default_path
    design = replace(case.design, stagger=False, oblique_m=vectors, attached=attached)
    return replace(case, design=design, bands=case.bands.but(path=path))


def _is_in_one_cell(case: Case) -> bool:
    """Whether rows are shifted, and panels half a pitch wide cannot hold their pillars, or what is attached to a cell."""
    design, pillar = case.design, case.design.pillar
    if not design.stagger or case.solve.model == SOLID:
        return False
    if design.attached or design.cell_file:
        return True
    return bool(pillar and _is_too_wide(design) and fits(shortest_vectors(*design.lattice.vectors_m), pillar))


def _is_too_wide(design: Design) -> bool:
    """Whether pillars are too wide for panels half a pitch wide."""
    reach = max((pillar.reach_m[0] for pillar in design.kinds), default=0.0)
    return design.pitch_x_m / 2.0 < (1.0 + MIN_GAP) * reach


def check_stagger(case: Case) -> None:
    """Raise InputError if staggered panels, half a pitch wide because both kinds of rows share lines, cannot hold a pillar."""
    design = case.design
    if _is_too_wide(design):
        reach = max(pillar.reach_m[0] for pillar in design.kinds)
        key = "array.pitch_mm" if design.lattice.is_triangular else "array.pitch_x_mm"
        need = f"{key} above {2e3 * reach:g}, twice the pillars' width, or solve.model = 'solid'"
        raise InputError(f"{case.source or case.name}: {_shifted(case)}: cells half a pitch wide need {need}")


def _shifted(case: Case) -> str:
    """The key that shifts rows, with its value."""
    return "array.lattice = 'triangular'" if case.design.lattice.is_triangular else "array.stagger = true"


def cell_model_choice(case: Case, high_hz: float = 0.0) -> ModelChoice:
    """Choose the model of the unit cell: reduced, or unreduced if the case requests a solid and boxes allow it.

    high_hz: highest frequency of the waves that are needed in addition to the lowest bands.

    Raises InputError for an unsuitable model.
    """
    case.require_one_kind("the unit cell is")
    check_model(case, _hexahedra(case, "cell"))
    design, accuracy = case.design, case.solve.accuracy
    no_cad = simplifications.hexahedra(case, "cell")
    if design.stagger and not no_cad and not design.cell_file:
        what = "needs pillars that hexahedra can follow, with room around their feet, and solve.mesh auto or hex"
        raise InputError(f"{case.source or case.name}: {_shifted(case)}: {what}")
    if design.oblique_m and not design.cell_file and (not no_cad or case.solve.model == SOLID):
        what = "a cell along two vectors of the lattice needs a pillar that hexahedra can follow, within its sides,"
        what += " solve.mesh auto or hex, and solve.model auto or superelement; --mesh-file takes any cell"
        raise InputError(f"{case.source or case.name}: array.a2_mm: {what}")
    taken = (simplifications.no_pillars(design, "cell"), no_cad)
    if case.solve.model == SOLID and no_cad:
        level, settings = mesh_rules.cell_level(accuracy), mesh_rules.cell_settings(design, accuracy)
        return _choice(case, "cell", SOLID, level, settings, None, taken, why="the case requests a solid")
    if design.stagger:
        check_stagger(case)
    reduction = mesh_rules.lattice_reduction(design, accuracy, _modes_end_hz(case, high_hz))
    edge = None if no_cad else mesh_rules.tet_cell_edge_m(design, accuracy)
    why, level = "one reduced pair of matrices serves every wavevector", mesh_rules.cell_level(accuracy)
    return _choice(case, "cell", SUPERELEMENT, level, reduction.hexahedra, edge, taken, reduction, why)


def with_defaults(case: Case, request: Request) -> Request:
    """Complete a request with the settings of the case, then with those of the predesign."""
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
    whole = query.part == "zone" and not {"x", "y"} <= {*case.design.stack.mirrors}
    plate = query.part == "plate" or whole
    target = case.target_symmetry if plate else target_symmetry(case.design.nodal_lines)
    return replace(query, band_hz=mesh_rules.target_window_hz(case.design), symmetry=query.symmetry or target)


def of_case(case: Case) -> Request:
    """Request of a study for the plate's modes: the windows of the case and the target mode joined, in its class."""
    solve = case.solve
    return with_search(case, Request("plate", solve.band_hz, solve.near_hz, solve.count, case.target_symmetry))


def target_window_hz(case: Case, query: Request) -> tuple[float, float] | None:
    """First search window of the target mode; None for parts and symmetry classes without one."""
    own = query.part in MEASURED and query.symmetry in (None, target_symmetry(case.design.nodal_lines))
    return mesh_rules.search_window_hz(case.design) if own else None


def model_high_hz(case: Case, query: Request) -> float:
    """Highest frequency that the model has to resolve, Hz: that of the request and of a target window that meets it."""
    high = query.highest_hz or (
        mesh_rules.target_window_hz(case.design)[1]
        if "zone" in case.given
        else mesh_rules.good_to_hz(query.part, case.design)
    )
    window = target_window_hz(case, query) if query.search else None
    meets = window and window[0] <= high and (query.band_hz is None or query.band_hz[0] <= window[1])
    return max(high, window[1]) if window and meets else high


def response_high_hz(case: Case, band_hz: tuple[float, float]) -> float:
    """Highest frequency that a response's plate has to resolve, Hz: that of the modes in its band, to share their panels."""
    return model_high_hz(case, Request("plate", band_hz))


def with_search(case: Case, query: Request) -> Request:
    """Join the band of a request with the target mode's window if they meet."""
    window = target_window_hz(case, query) if query.search else None
    band = query.band_hz
    if not window or not band or band[0] > window[1] or window[0] > band[1]:
        return query
    return replace(query, band_hz=(min(band[0], window[0]), max(band[1], window[1])))


def driven_band_hz(case: Case, band_hz: tuple[float, float] | None) -> tuple[float, float]:
    """Band of a response or an attenuation: the given one, else the case's, else one around the target mode.

    Raises InputError for a case without any of them, or whose band begins at 0.
    """
    if not (band_hz or case.solve.band_hz or "zone" in case.given):
        raise InputError(
            f"{case.source or case.name}: --band: missing, it is the target mode's only where there is a [zone]"
        )
    if not band_hz and case.solve.band_hz and not case.solve.band_hz[0]:
        low, high = (end / KHZ for end in case.solve.band_hz)
        raise InputError(
            f"{case.source or case.name}: solve.band_kHz = [{low:g}, {high:g}]: "
            "must begin above 0 for this command, or give --band"
        )
    return band_hz or case.solve.band_hz or mesh_rules.target_window_hz(case.design)


def _hexahedra(case: Case, part: str) -> bool:
    """Whether hexahedra can mesh a part, or the case does not insist on them."""
    return case.solve.mesh != HEX or simplifications.hexahedra(case, part) is not None


def _lone_part(case: Case, part: str, high_hz: float) -> ModelChoice:
    """Choose the model of the zone between clamped sides, or of the pillar on a clamped foot."""
    design, accuracy = case.design, case.solve.accuracy
    if part == "pillar":
        case.require_one_kind("the isolated pillar is")
    no_cad = simplifications.hexahedra(case, part)
    quarter = simplifications.mirror_images(design, part) if no_cad or part == "zone" else None
    level, top_hz = mesh_rules.reaching(part, design, accuracy, high_hz)
    hexahedra = mesh_rules.lone_mesh(part, design, level, top_hz) if no_cad else None
    smallest_m = design.pillar.smallest_m if part == "pillar" and design.pillar else 2.0 * design.thickness_m
    edge = None if no_cad else mesh_rules.tet_edge_m(smallest_m, accuracy)
    taken = no_cad, quarter, simplifications.no_supports(design)
    return _choice(case, part, SOLID, level, hexahedra, edge, taken, good_to_hz=top_hz)


def _plate(case: Case, high_hz: float) -> ModelChoice:
    design, accuracy = case.design, case.solve.accuracy
    bare, no_cad = simplifications.no_pillars(design, "plate"), simplifications.hexahedra(case, "plate")
    taken: tuple[Simplification | None, ...] = (bare, no_cad, simplifications.mirror_images(design, "plate"))
    if case.solve.model == SOLID and design.supports:
        what = "must be auto or superelement: a supported plate is assembled from cells"
        raise InputError(f"{case.source or case.name}: solve.model = 'solid': {what}")
    if design.outline and case.solve.model == SUPERELEMENT:
        what = "must be auto or solid: a plate of plate.file is solved whole"
        raise InputError(f"{case.source or case.name}: solve.model = 'superelement': {what}")
    if case.solve.model == SOLID or design.outline:
        level = mesh_rules.whole_level(design, accuracy, high_hz)
        hexahedra = mesh_rules.cell_mesh(design, level) if no_cad else None
        edge = None if no_cad else mesh_rules.tet_plate_edge_m(design, accuracy)
        why = "a plate of a file is solved whole" if design.outline else "the case requests a solid"
        return _choice(case, "plate", SOLID, level, hexahedra, edge, taken, why=why, table="whole")
    if design.is_staggered:
        check_stagger(case)
    reduction = mesh_rules.plate_reduction(design, accuracy, high_hz)
    edge = None if no_cad or bare else mesh_rules.tet_cell_edge_m(design, accuracy)
    why = "assembling cells needs one reduction per kind; their error estimate refines the mesh if necessary"
    taken = (*taken, simplifications.alike_cells(design))
    level = mesh_rules.cell_level(accuracy)
    return _choice(case, "plate", SUPERELEMENT, level, reduction.hexahedra, edge, taken, reduction, why)


def spared(case: Case, choice: ModelChoice, high_hz: float) -> ModelChoice:
    """Choose a plate's reduction without the boundary functions that bare panels do without, where it has them.

    For modes alone: patches and fingers on bare panels feel all functions, and drifts are differences of small changes.
    """
    reduction = choice.reduction
    rule = simplifications.bare_functions(case.design, reduction.further) if reduction else None
    if reduction is None or rule is None or choice.part != "plate":
        return choice
    sparing = high_hz, SPARED * case.solve.accuracy
    return replace(choice, reduction=replace(reduction, sparing=sparing), left_out=(*choice.left_out, rule))


def _modes_end_hz(case: Case, high_hz: float) -> float:
    """Highest useful cut-off of the fixed-interface modes, Hz; infinite if no pillar has modes below the plate's.

    Panels of staggered rows keep as many as those of a plate.
    """
    design = case.design
    if design.pillar is None:
        return inf
    try:
        end_hz = bands_end_hz(case)
    except SolverError:  # more modes than a coarse mesh can count
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
        known = "" if error is None else f" (error {percent(error)} on the calibrated design)"
        mesh = f"order {hexahedra.order} with {several(hexahedra.layers, 'graded layer')}{known}"
        return (f"{accuracy} selects {mesh}; two coarser meshes estimate the error, which refines it if necessary",)
    scene = "outline" if part == "whole" and case.design.outline else "pillar"
    shape = "the case requests tetrahedra" if case.solve.mesh == TET else f"hexahedra cannot follow the {scene}"
    return (
        shape,
        f"{accuracy} sets their edge length; stress recovery estimates the error, which shortens it if necessary",
    )


def _mm(length_m: float) -> str:
    return f"{figure(1e3 * length_m)} mm"
