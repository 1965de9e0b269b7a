"""Resource estimate of each step of a plan; only a coarse cell and the panels around round feet are meshed for it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from math import ceil, floor, pi

import numpy as np

from geometry.hex.panels import disc_mesh, panel_mesh, square_of, with_nodes_along
from geometry.hex.scenes import (
    BoxCounts,
    HexSettings,
    Scene,
    bonded_scene,
    box_counts,
    cell_scene,
    panel_scene,
    part_scene,
)
from geometry.layout import Design
from geometry.materials import Stack
from geometry.mesh import Mesh
from geometry.supports import SOFT, Support, is_held_disc
from geometry.tiling import Panel, Tiling, grid, tile
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import HEX, SOLID, ModelChoice, Request, model_choice_of, model_high_hz
from pipeline.planning.resources import GIB, ResourceEstimate, refuse, shortfall
from pipeline.quantity import KHZ
from solvers.analytic.plates import highest_hz, pillar_modes, plate_modes
from solvers.fem.cost import (
    ENTRY,
    Cost,
    Fill,
    MeshCounts,
    Stage,
    assembly,
    factorisation,
    grid_fill,
    modal_solve,
    nodal,
    panelled,
    solid_modes,
)
from solvers.machine import workers
from solvers.superelement.interface import Interface, ReductionSettings

HIGH_HZ = 1e6  # a window above it that does not fit into the memory was probably meant in Hz
MAX_LINES = 2_000_000  # of a plate's grid: beyond it, lines are counted without being generated
MANY_FUNCTIONS = 1000  # of one cell or panel: some 300 are common
DENSE_COPIES = 34  # of a lattice's matrices: nine steps of K and of M, and the work space of one wavevector
DENSE_OPERATIONS = 2.0  # of a dense eigen-solve over n^3
# times accuracy^-1/4 and the highest band: the uncertainty due to modes discarded above L goes as L^-4
CUTOFF = 0.64
GAP_SOLVES = 110  # wavevectors for crossings and gap edges, in addition to the path's
EDGE_SOLVES = 8  # those for gap edges of a cell solved as meshed: none without a gap, up to a hundred with several
# in addition to the dense solve, per wavevector: pencil, phases, labels; per wave and cell entry: slopes, overlaps
SOLVE_OPERATIONS, WAVE_OPERATIONS, WAVES_ABOVE = 5e7, 8.0, 6
# equivalent of meshing, assembling, joining and bounding three nested meshes of a cell; of each coarse cell that sets its
# reduction
CELL_OPERATIONS, COARSE_CELLS, COARSE_OPERATIONS = 5e9, 2, 2e9
LOWERED = 16.0  # operations over n^3 to find the correction of a cell from its coarser meshes
COMPLEX = 2.5  # times a real dense solve
COLUMN_SOLVES, SWEEP = 2.0, 8.0  # solves per boundary function, and operations of each per entry of the factor
# times the work on a panel's own mesh: includes the meshes of one order less and without the innermost layer
NESTED = 1.4
ALIKE = 1.8  # equivalent number of classes instead of four: one is a rotated copy, two split into halves
# times the work on the finest mesh about a held disc: includes the coarser one; share of the panels' functions that move it
COARSER, MOVING = 1.3, 0.3
JOINING_BYTES = 45.0  # per entry of a panel's matrices while they are summed
PANEL_OPERATIONS = 2e6  # equivalent of numbering the degrees of freedom in one panel
TETRAHEDRA = 10.0  # times volume over edge cubed, graded edges included
NEAR_FEET = 0.5  # times pillar and plate near its foot, where a plate of a file is finer: further volume of elements
NODES, PAIRS = 1.45, 28.0  # a quadratic tetrahedron's nodes; nodes that share an element with one
TET_FILL = 4.0  # entries of the factor over n^(4/3)
# times the elements of a square prism's panel: those of a disc's, where meshing it just to count them costs too much
CURVED, MESHED = 2.0, 50_000
# share of the boundary functions that bare panels keep where they may do without; panels that keep all, per pillar
KEPT, ABOUT_FEET = 0.45, 1.5
# of a mode's motion on a panel's touch face: of some 420 points, whole and in two parts
MEASURED_BYTES = 2.5 * 8.0 * 420.0
CLASS_MATRICES = 3  # of a symmetry class: its K, its M and one shifted
PILOT_BYTES = 0.07 * GIB  # heap that the solves of a coarse cell leave behind
HEAP_BYTES = 0.25 * GIB  # that the heap keeps of what it no longer needs (`solvers.threads`)
SKIN = 0.4  # of a panel's nodes that lie on its surface
EMBEDDED = 2.2  # entries of the real embedding over those of the cell
SPLIT_BYTES, SPLIT_KEPT = 70.0, 16.0  # per entry, while the cell is split by phases, and afterwards

Kind = tuple[MeshCounts, float, int]  # a kind of panel: its mesh, fixed-interface modes, copies of the mesh per panel


def log_estimate(what: str, demand: ResourceEstimate, log: Log) -> None:
    """Log the resource estimate of a computation before it begins; InputError if it exceeds the available memory."""
    refuse({what: demand})
    log.info(demand.text())
    if demand.functions and demand.functions > MANY_FUNCTIONS:
        log.warning(
            "MANY_FUNCTIONS",
            f"{what}: the reduction keeps about {demand.functions} functions per {demand.per}; the plate sets its cut-off, at "
            "which waves in so soft or large a pillar are short. Expect long run times and high memory use",
        )


def fits(demand: ResourceEstimate, log: Log) -> bool:
    """Whether a finer mesh fits into the available memory; logged either way."""
    reason = shortfall(demand)
    log.info(f"finer mesh skipped: it {reason}" if reason else demand.text())
    return reason is None


# -- bodies ------------------------------------------------------------------------------------------------------------


def of_boxes(scene: Scene, order: int) -> MeshCounts:
    """Count the elements and the fill of a mesh of boxes."""
    counts = box_counts(scene, order)
    return MeshCounts(counts.elements, (order + 1) ** 3, counts.nodes, counts.pairs, _box_fill(counts))


def _box_fill(counts: BoxCounts) -> Fill:
    """Fill of the meshes of the body and of every pillar, whose foot belongs to the body."""
    total, dofs = Fill(), nodal(counts.order)
    for block in (block for block in counts.blocks if block.sign > 0):
        ends = ((True, True), (True, True), (not block.stands, True))
        for nx, columns in Counter(block.x).items():
            for ny, rows in Counter(block.y).items():
                total += grid_fill((nx, ny, block.z), dofs, ends).times(columns * rows)
    return total


def of_tetrahedra(volume_m3: float, edge_m: float) -> MeshCounts:
    """Estimate the number of quadratic tetrahedra of a given edge length."""
    elements = TETRAHEDRA * volume_m3 / edge_m**3
    nodes = NODES * elements
    entries = TET_FILL * (3.0 * nodes) ** (4.0 / 3.0)
    return MeshCounts(elements, 10, nodes, PAIRS * nodes, Fill(entries, entries**1.5, entries))


# -- isolated parts and plates meshed whole ----------------------------------------------------------------------------


def of_modes(case: Case, choice: ModelChoice, query: Request) -> ResourceEstimate:
    """Estimate the modes of a part for its model choice."""
    high, total = _window(case, choice, query)
    if query.count is not None and not query.band_hz and choice.part != "plate" and choice.kind == HEX:
        choice = model_choice_of(case, choice.part, max(high, model_high_hz(case, query)))
    classes = 1 if query.symmetry else len(choice.classes)
    each = total if not choice.quarter else total / 4.0
    near = query.band_hz is None
    each = float(query.count) if near and query.count is not None else each
    change = _changes(case, choice, query)
    if choice.reduction is not None:
        plates = 2 if case.design.supports and not (classes == 1 and _is_followed(case, choice, query)) else 1
        return _assembled(case, choice, choice.reduction, classes, each, near, change, plates)
    mesh = whole_mesh(case, choice)
    each = min(each, mesh.dofs)
    reported = min(each, total) if near else classes * each
    solve = modal_solve(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, each, near)
    return ResourceEstimate(
        solid_modes(mesh, classes, each, near),
        reported,
        change=change,
        cad=choice.kind != HEX,
        parallel_bytes=_parallel_bytes(classes, solve),
    )


def of_meshed_whole(case: Case, accuracy: float, count: int) -> ResourceEstimate:
    """Estimate a few modes of one symmetry class of a plate meshed whole by tetrahedra."""
    whole = replace(case, solve=case.solve.but(mesh="tet", model=SOLID, accuracy=accuracy))
    query = Request(
        "plate", near_hz=mesh_rules.target_window_hz(case.design)[0], count=count, symmetry=case.target_symmetry
    )
    return of_modes(whole, model_choice_of(whole, "plate", model_high_hz(whole, query)), query)


def _window(case: Case, choice: ModelChoice, query: Request) -> tuple[float, float]:
    """Highest frequency searched, Hz, and the number of modes expected in the whole part."""

    def below(frequency_hz: float) -> float:
        return part_modes(case.design, choice.part, frequency_hz)

    if query.band_hz:
        low, high = query.band_hz
        return high, max(0.0, below(high) - below(low))
    near, count = query.near_hz or 0.0, float(query.count or 0)
    high = highest_hz(below(near) + count / 2.0 if near else count, below, max(near, 1.0))
    return high, count


def part_modes(design: Design, part: str, frequency_hz: float) -> float:
    """Number of modes of a whole part below a frequency."""
    if part == "pillar":
        assert design.pillar
        return pillar_modes(frequency_hz, design.pillar)
    if part == "zone":
        clamped_m = 2.0 * design.length_m
        return plate_modes(
            frequency_hz, design.length_m, design.width_m, design.thickness_m, design.stack.mean, clamped_m
        )
    plate = plate_modes(frequency_hz, *design.plate_m, design.thickness_m, design.stack.mean)
    if design.lists_feet and design.pillar:
        return plate + pillar_count(design) * design.pillar.faces * pillar_modes(frequency_hz, design.pillar)
    own = Counter(design.row_pillars)
    shared = design.shared_rows * (design.zones - 1) / 2.0  # a row stands for two, one on each side
    if design.pillar and shared:
        own[design.pillar] += shared  # type: ignore[assignment]
    pillars = (
        _per_row(design) * rows * pillar.faces * pillar_modes(frequency_hz, pillar) for pillar, rows in own.items()
    )
    return plate + sum(pillars)


def pillar_count(design: Design) -> int:
    """Number of pillars of the plate, without listing them unless they surround a zone."""
    if design.lists_feet:
        return len(design.pillar_centres())
    rows = 2 * design.rows + design.shared_rows * (design.zones - 1)
    shifted = design.rows // 2 if design.is_staggered else 0
    return rows * _per_row(design) // 2 - 2 * shifted if design.row_pillars else 0


def _per_row(design: Design) -> int:
    """Pillars of a row on both sides of the zone."""
    return 2 * (floor((design.length_m - design.footprint_m) / design.pitch_x_m + 1e-6) + 1)


def whole_mesh(case: Case, choice: ModelChoice) -> MeshCounts:
    """Counts of the mesh of a part that is solved without reduction."""
    design = case.design
    if choice.kind != HEX:
        assert choice.edge_m
        volume_m3 = _volume_m3(design, choice.part) / (4.0 if choice.quarter and choice.part != "pillar" else 1.0)
        if choice.part == "plate" and design.outline:
            volume_m3 += NEAR_FEET * sum(
                len(stand.centres)
                * (stand.pillar.volume_m3 + (stand.pillar.widest_m + choice.edge_m) ** 2 * choice.edge_m)
                for stand in design.standing()
            )
        return of_tetrahedra(volume_m3, choice.edge_m)
    assert choice.hexahedra
    if choice.part == "plate" and choice.quarter and pillar_count(design) > MAX_LINES:
        return _many_pillars(design, choice.hexahedra)
    return of_boxes(part_scene(design, choice.part, choice.hexahedra, choice.quarter), choice.hexahedra.order)


def _many_pillars(design: Design, settings: HexSettings) -> MeshCounts:
    """Counts of a plate with too many pillars to list, from an equal number of cells."""
    cell = of_boxes(cell_scene(design, settings), settings.order)
    many = pillar_count(design) / 4.0
    return MeshCounts(
        many * cell.elements, cell.corners, many * cell.nodes, many * cell.pairs, cell.fill.times(round(many))
    )


def _volume_m3(design: Design, part: str) -> float:
    pillar = design.pillar
    one = pillar.volume_m3 if pillar else 0.0
    if part == "pillar":
        return one
    if part == "cell":
        return design.lattice.area_m2 * design.thickness_m + (one * pillar.faces if pillar else 0.0)
    if part == "zone":
        return design.length_m * design.width_m * design.thickness_m
    plate = design.plate_m[0] * design.plate_m[1] * design.thickness_m
    plate = design.outline.volume_m3 if design.outline else plate
    if design.lists_feet and pillar:
        return plate + pillar_count(design) * pillar.faces * one
    return plate + (
        _per_row(design) * sum(each.faces * each.volume_m3 for each in design.row_pillars)
        if pillar_count(design)
        else 0.0
    )


# -- reduced panels and what is assembled from them -------------------------------------------------------------------------


@dataclass(frozen=True)
class AssembledClass:
    """Sizes of the tiling and matrices of one symmetry class of a plate of reduced panels, or of the whole plate.

    functions: of an average panel; inner: fixed-interface modes of the panel that has most; summed: entries of all panel
    matrices; entries: those of the assembled matrix, in which shared degrees of freedom count once.
    """

    design: Design
    reduction: ReductionSettings
    quarter: bool
    panels: int
    kinds: list[Kind]
    functions: float
    inner: float
    dofs: float
    summed: float
    entries: float
    fill: Fill

    @property
    def kept_bytes(self) -> float:
        """Bytes of the reduced panels."""
        return len(self.kinds) * 24.0 * (self.reduction.interface.count + self.inner) ** 2

    @property
    def bare_modes(self) -> float:
        """Fixed-interface modes of a panel without a pillar."""
        return self.kinds[0][1]

    @cached_property
    def tiling(self) -> Tiling:
        """The plate's panels."""
        return tile(self.design, self.reduction.max_edge_m)


def assembled_class(design: Design, choice: ModelChoice, reduction: ReductionSettings) -> AssembledClass:
    """Sizes of a symmetry class of a plate of reduced panels."""
    nx, ny = _panels(design, reduction)
    kinds = _panel_kinds(design, reduction, choice)
    mean = _mean_functions(design, kinds, nx * ny)
    across = (ceil(nx / 2), ceil(ny / 2)) if choice.quarter else (nx, ny)
    face, count = reduction.interface, across[0] * across[1]
    kept = 1.0
    if reduction.sparing:
        kept -= (1.0 - KEPT) * max(1.0 - ABOUT_FEET * pillar_count(design) / (nx * ny), 0.0)
    vertex, side = kept * face.vertex_block, kept * face.side_block
    fill = grid_fill(across, panelled(vertex, side, mean))
    dofs, inner = count * (vertex + 2 * side + mean), max(each for _, each, _ in kinds)
    own = kept * face.count + mean
    sides = 2 * count - across[0] - across[1]  # between two panels
    corners = (across[0] - 1) * (across[1] - 1)  # of four panels and four sides
    entries = count * own**2 - sides * (side + 2.0 * vertex) ** 2 + corners * vertex**2
    return AssembledClass(
        design, reduction, choice.quarter, nx * ny, kinds, own, inner, dofs, count * own**2, entries, fill
    )


def _assembled(
    case: Case,
    choice: ModelChoice,
    reduction: ReductionSettings,
    classes: int,
    modes: float,
    near: bool,
    change: tuple[str, ...],
    plates: int,
) -> ResourceEstimate:
    """Estimate a plate assembled from panels: the reductions, then the assembled classes, as often as it is solved."""
    own = assembled_class(case.design, choice, reduction)
    reducing = Cost()
    for body, functions, copies in own.kinds:
        is_alike = copies == 4 and "d" in case.design.cell_mirrors
        reducing = reducing.then(panel_reduction(body, reduction.ample, functions, copies, is_alike))
    modes, kept = min(modes, own.dofs), own.kept_bytes
    joining = Stage("joining the panels", JOINING_BYTES * own.summed)
    solve = modal_solve(own.dofs, own.entries, own.fill, modes, near)
    cost = reducing.then(Cost((joining,), classes * PANEL_OPERATIONS * own.panels), kept)
    for holding, held_bytes in _held_discs(own):
        cost, kept = cost.then(holding, kept), kept + held_bytes
    kept_bytes = kept + 3.0 * 12.0 * own.entries + (classes - 1) * 8.0 * own.dofs * modes
    panels = own.panels / (4.0 if own.quarter else 1.0)
    measuring = Cost((Stage("measuring the modes", MEASURED_BYTES * panels * modes),))
    for _ in range(classes):
        cost = cost.then(solve, kept_bytes + min(reducing.peak.bytes, HEAP_BYTES))
    cost = cost.then(measuring, plates * kept_bytes + reducing.peak.bytes)  # what the reductions took is not returned
    return ResourceEstimate(
        cost,
        modes if near else classes * modes,
        round(reduction.interface.count + own.inner),
        own.panels,
        change,
        choice.kind != HEX,
        _parallel_bytes(classes, solve),
    )


BENDS = 1.2  # times what a panel that does not bend bears


def _is_followed(case: Case, choice: ModelChoice, query: Request) -> bool:
    """Whether the modes without supports are expected to follow from those with them (`solvers.plates.released`)."""
    free, reduction = replace(case, design=case.design.unsupported), choice.reduction
    if reduction is None or not query.band_hz or case.target_symmetry != free.target_symmetry:
        return False
    held = case.design.is_stressed or any(each.held_axes for each in case.design.supports)
    return not held and softness(case.design, tile(case.design, reduction.max_edge_m), query.band_hz[0]) <= SOFT


def softness(design: Design, tiling: Tiling, low_hz: float) -> float:
    """Estimate what springs and masses add to the plate's stiffness and inertia, relative, at a frequency in Hz.

    The panel that bears a support moves as a whole and tilts: a force at its edge finds a quarter of its mass, at a corner a
    seventh. Its own bending adds a little.
    """
    squared, surface, total = (2.0 * pi * low_hz) ** 2, design.stack.mass_kg_m2, 0.0
    (across, along), places = design.plate_m, [np.diff(lines) for lines in (tiling.x, tiling.y)]
    for each in design.supports:
        axis, length = "xy".find(each.edge[:1]), {"x": along, "y": across}.get(each.edge[:1], 0.0)
        if each.edge:
            share = 4.0 / (surface * length * places[axis][0 if each.edge[1] == "-" else -1])
        else:
            at = [
                np.searchsorted(lines, place) - 1 for lines, place in zip((tiling.x, tiling.y), each.at_m, strict=True)
            ]
            share = 7.0 / (surface * places[0][at[0]] * places[1][at[1]])
        total += BENDS * float(share) * (each.stiffness_of(length) / squared + each.mass_kg)
    return total


def _held_discs(own: AssembledClass) -> Iterator[tuple[Cost, float]]:
    """Cost of the static solves about each held disc that is no other's image, and bytes of what they add to the plate."""
    if not any(map(is_held_disc, own.design.supports)):
        return
    from solvers.plates.held import disc_settings, distinct  # slow to import, and of no use to other plates
    from solvers.superelement.bond import between

    tiling, design, face = own.tiling, own.design, own.reduction.interface
    for disc, _ in distinct(design.supports, not own.quarter):
        box = disc.box_m.reshape(2, 2)
        (left, right), (low, high) = (
            between(lines, ends, design.thickness_m) for lines, ends in zip((tiling.x, tiling.y), box, strict=True)
        )
        x, y = tiling.x[left : right + 2], tiling.y[low : high + 2]
        settings = disc_settings(own.reduction, max(float(np.diff(line).max()) for line in (x, y)))
        mesh = _of_disc(Panel((x[0], y[0]), (x[-1], y[-1]), disc.at_m), disc, design.stack, settings)
        nx, ny = len(x) - 1, len(y) - 1
        sides = nx * (ny + 1) + ny * (nx + 1)
        felt = (nx + 1) * (ny + 1) * face.vertex_block + sides * face.side_block + nx * ny * own.bare_modes
        loads = MOVING * felt
        answers = Stage("solving about a held disc", 16.0 * loads * mesh.dofs)
        solve = factorisation(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, 1.0)
        solve = solve.then(Cost((answers,), 8.0 * mesh.fill.entries * loads), 15.0 * mesh.fill.entries)
        whole = assembly(mesh).then(solve, mesh.mesh_bytes + 3.0 * 9.0 * 12.0 * mesh.pairs)
        yield replace(whole, operations=COARSER * whole.operations), 16.0 * felt**2


def _of_disc(panel: Panel, disc: Support, stack: Stack, settings: HexSettings) -> MeshCounts:
    """Counts of the panels about a disc: those of a square one, scaled by its nodes where they are quickly counted."""
    ends = np.array([panel.low, panel.high]).T.ravel()
    mesh = of_boxes(bonded_scene(ends, stack, (), disc.box_m, True, settings), settings.order)
    if mesh.elements > MESHED:
        return mesh
    return _times(mesh, len(disc_mesh(panel, stack, disc.radius_m, settings).nodes) / mesh.nodes)


def _times(mesh: MeshCounts, more: float) -> MeshCounts:
    """Counts of a mesh like another one with so many times its nodes."""
    fill = Fill(*(more ** (4.0 / 3.0) * part for part in astuple(mesh.fill)))
    return MeshCounts(more * mesh.elements, mesh.corners, more * mesh.nodes, more * mesh.pairs, fill)


def _parallel_bytes(classes: int, solve: Cost) -> float:
    """Bytes of the symmetry classes that are solved in parallel with the first one."""
    return (min(classes, workers()) - 1) * solve.peak.bytes


def of_panels(design: Design, choice: ModelChoice, reduction: ReductionSettings) -> float:
    """Peak memory of reducing the costliest kind of panel, B."""
    kinds = _panel_kinds(design, reduction, choice)
    return max(
        panel_reduction(body, reduction.ample, functions, copies).peak.bytes for body, functions, copies in kinds
    )


def _panels(design: Design, reduction: ReductionSettings) -> tuple[int, int]:
    """Number of panels along x and y."""
    bare = design.plate_m[0] / reduction.max_edge_m, design.plate_m[1] / reduction.max_edge_m
    many = pillar_count(design)
    if many > MAX_LINES or max(bare) > MAX_LINES:
        columns = many / (2 * design.rows) if design.rows else 0.0
        return ceil(max(columns, bare[0] if not columns else 0.0)), 2 * design.rows + ceil(bare[1])
    x, y = grid(design, reduction.max_edge_m)
    return len(x) - 1, len(y) - 1


def _panel_kinds(design: Design, reduction: ReductionSettings, choice: ModelChoice) -> list[Kind]:
    """Mesh of the largest panel of each kind, with its fixed-interface modes."""
    longest = reduction.max_edge_m
    bare_m = (design.pitch_x_m if design.rows else longest, longest)
    settings = reduction.hexahedra
    bare = Panel((-bare_m[0] / 2.0, -bare_m[1] / 2.0), (bare_m[0] / 2.0, bare_m[1] / 2.0), None, (0, 1))
    mesh = of_boxes(
        panel_scene(bare, design.stack, None, replace(settings, size_m=reduction.bare_size_m or settings.size_m)),
        settings.order,
    )
    kinds: list[Kind] = [(mesh, fixed_modes(design, reduction, False, bare_m, mesh), 4)]
    if design.pillar and design.rows:
        halves = ((0, 1), (1,)) if choice.quarter else ((),)
        kinds += [
            _pillar_panel(row, reduction, choice, (row.pitch_x_m / (1 + design.is_staggered), row.pitch_y_m), halved)
            for row in design.row_designs
            for halved in halves
        ]
    return kinds


def _pillar_panel(
    design: Design,
    reduction: ReductionSettings,
    choice: ModelChoice,
    pitch: tuple[float, float],
    halved: tuple[int, ...],
) -> Kind:
    low, high = (-pitch[0] / 2.0, -pitch[1] / 2.0), (pitch[0] / 2.0, pitch[1] / 2.0)
    if choice.kind != HEX:
        assert choice.edge_m
        mesh = of_tetrahedra(_volume_m3(design, "cell") / 2 ** len(halved), choice.edge_m)
    else:
        mesh = _of_hexahedra(design, Panel(low, high, (0.0, 0.0) if design.pillar else None, halved), reduction)
    return mesh, fixed_modes(design, reduction, bool(design.pillar), pitch, mesh), 2 ** len(halved)


def _of_hexahedra(design: Design, panel: Panel, reduction: ReductionSettings) -> MeshCounts:
    """Counts of a panel with its pillar; those of a square foot are scaled for a curved one."""
    pillar, settings = design.pillar, reduction.hexahedra
    alike = square_of(pillar) if pillar else None
    mesh = of_boxes(panel_scene(panel, design.stack, alike, settings), settings.order)
    if pillar is None or pillar.form.plan != "disc":
        return mesh
    own = CURVED
    if CURVED * mesh.elements < MESHED:

        def meshed(other: HexSettings) -> Mesh:
            return panel_mesh(panel, design.stack, pillar, other).mesh

        settings = with_nodes_along(panel, reduction.interface.along, settings, meshed)
        own = len(meshed(settings).nodes) / mesh.nodes
    return _times(mesh, own)


def fixed_modes(
    design: Design, reduction: ReductionSettings, foot: bool, size_m: tuple[float, float], mesh: MeshCounts
) -> float:
    """Fixed-interface modes that a panel keeps, no more than its mesh can have."""
    rim = 2.0 * sum(size_m)
    count = plate_modes(reduction.top_hz, *size_m, design.thickness_m, design.stack.mean, rim)
    if foot and design.pillar:
        count += design.pillar.faces * pillar_modes(reduction.top_hz, design.pillar)
    return min(count, 0.8 * mesh.dofs)


def _mean_functions(design: Design, kinds: list[Kind], panels: int) -> float:
    """Fixed-interface modes of an average panel."""
    share = min(1.0, pillar_count(design) / max(panels, 1))
    return share * kinds[-1][1] + (1.0 - share) * kinds[0][1]


def panel_reduction(
    mesh: MeshCounts, face: Interface, functions: float, copies: int, is_alike: bool = False, at_once: int = 1
) -> Cost:
    """Cost of reducing one panel of `copies` times its mesh, class by class: matrices, constraint modes, fixed-interface modes
    and nested meshes. is_alike: a quarter that is symmetric under exchange of x and y; at_once: classes solved in parallel.
    """
    surface = 2.0 * SKIN * copies * mesh.dofs * 8.0 * (face.count + functions)
    shapes = 8.0 * mesh.dofs * (face.count + functions)
    kept_bytes = mesh.mesh_bytes + 2.0 * 9.0 * 12.0 * mesh.pairs
    solve = modal_solve(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, functions / 2.0)
    solve = replace(solve, stages=tuple(Stage(stage.name, at_once * stage.bytes) for stage in solve.stages))
    shaping = Stage(
        "projecting a reduced cell", kept_bytes + 4.0 * shapes + surface + 24.0 * (face.count + functions) ** 2
    )
    own_bytes = at_once * CLASS_MATRICES * ENTRY * 9.0 * mesh.pairs
    first = assembly(mesh).then(solve, kept_bytes + own_bytes).then(Cost((shaping,)))
    of_class = modal_solve(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, functions / copies).operations
    columns = COLUMN_SOLVES * SWEEP * mesh.fill.entries * face.count / copies
    projecting = 6.0 * mesh.dofs * (face.count + functions) ** 2 / copies
    operations = NESTED * (ALIKE if is_alike else copies) * (of_class + columns + projecting)
    return replace(first, operations=operations)


# -- unit cells --------------------------------------------------------------------------------------------------------


def of_bands(case: Case, choice: ModelChoice, wavevectors: int) -> ResourceEstimate:
    """Estimate the bands at a number of wavevectors, and the finer meshes that may follow."""
    design, bands = case.design, case.bands
    inside = len(design.lattice.grid(bands.grid, design.cell_mirrors)) if bands.grid else 0
    if choice.reduction is None:
        return _meshed_cell(case, choice, wavevectors + EDGE_SOLVES + inside)
    if design.stagger:
        path = bands.segments * bands.points + 1  # branches are not followed between these points
        return _of_cell(case, choice, COMPLEX * DENSE_OPERATIONS, min(wavevectors, path) + inside)
    return _of_cell(case, _advised(case, choice), DENSE_OPERATIONS, wavevectors + GAP_SOLVES + inside, COARSE_CELLS)


def of_attenuation(case: Case, choice: ModelChoice, frequencies: int) -> ResourceEstimate:
    """Estimate complex bands at a number of frequencies; the bare cell is reduced, too."""
    assert choice.reduction
    if case.design.stagger:
        return _of_cell(case, choice, COMPLEX * DENSE_OPERATIONS, frequencies)
    return _of_cell(case, _advised(case, choice), 2.0 * DENSE_OPERATIONS, frequencies, COARSE_CELLS)


def of_finer_mesh(case: Case, choice: ModelChoice, wavevectors: int) -> ResourceEstimate:
    """Estimate a cell of given reduction settings on a finer mesh, with its bands at the corners of the path."""
    return _of_cell(case, choice, DENSE_OPERATIONS, wavevectors)


def _advised(case: Case, choice: ModelChoice) -> ModelChoice:
    """The choice with the degree along the sides and the cut-off that coarse cells are expected to give for the bands."""
    from pipeline.planning.model_choice import bands_end_hz  # solves: a plan of a plate loads no solver

    reduction, design, accuracy = choice.reduction, case.design, case.solve.accuracy
    if reduction is None or design.pillar is None:
        return choice
    end_hz = bands_end_hz(case)
    along = mesh_rules.degree_along(design, accuracy, end_hz, reduction.interface.along)
    face = replace(reduction.interface, along=along)
    return replace(choice, reduction=replace(reduction, interface=face, top_hz=CUTOFF * accuracy**-0.25 * end_hz))


def _of_cell(case: Case, choice: ModelChoice, operations: float, solves: float, pilots: int = 0) -> ResourceEstimate:
    """Estimate `pilots` coarse cells and `solves` dense solves of the reduced one, at `operations` times n^3 each."""
    demands = [
        _lattice(*_reduced_cell(case, each, each.reduction), operations, solves, case, choice)
        for each in (choice, *_finer_meshes(case.design, choice))
        if each.reduction
    ]
    whole = replace(demands[0], finer_bytes=tuple(each.memory_bytes for each in demands[1:]))
    return replace(whole, cost=Cost((), pilots * COARSE_OPERATIONS).then(whole.cost, PILOT_BYTES))


def _finer_meshes(design: Design, choice: ModelChoice) -> Iterator[ModelChoice]:
    """Reduced cell on each finer mesh level that has more elements."""
    level = choice.mesh_level
    while choice.reduction and level and (level := mesh_rules.finer_cell_level(level)):
        mesh = mesh_rules.with_nodes_for(choice.reduction.interface, mesh_rules.cell_mesh(design, level))
        before = cell_dofs(design, choice)
        choice = replace(choice, hexahedra=mesh, mesh_level=level, reduction=replace(choice.reduction, hexahedra=mesh))
        if before < cell_dofs(design, choice):
            yield choice


def cell_dofs(design: Design, choice: ModelChoice) -> float:
    """Degrees of freedom of the cells of a design's rows in hexahedra; curved feet count as square ones."""
    assert choice.hexahedra
    boxes = [replace(row, pillar=row.pillar and square_of(row.pillar)) for row in design.row_designs]
    return sum(of_boxes(cell_scene(row, choice.hexahedra), choice.hexahedra.order).dofs for row in boxes)


def _reduced_cell(case: Case, choice: ModelChoice, reduction: ReductionSettings) -> tuple[Cost, int, float]:
    """Cost of reducing the unit cell, its degrees of freedom per wavevector, and those in total."""
    design, face = case.design, reduction.interface
    pitch = (design.pitch_x_m / (2 if design.stagger else 1), design.pitch_y_m)
    halved = (0, 1) if {"x", "y"} <= {*design.cell_mirrors} else ()
    mesh, functions, copies = _pillar_panel(design, reduction, choice, pitch, halved)
    if design.pillar:
        functions = min(_kept_modes(case, reduction, pitch, mesh), 0.8 * mesh.dofs)
    is_alike = "d" in design.cell_mirrors and len(halved) == 2  # then the largest classes are halves of one
    at_once = 1 if is_alike else min(workers(), copies)
    reducing = panel_reduction(mesh, face, functions, copies, is_alike, at_once)
    cells = 2 if design.stagger else 1  # of a row: a panel with a pillar and a bare one
    whole = face.count + functions
    reducing = replace(reducing, operations=reducing.operations + cells * (CELL_OPERATIONS + LOWERED * whole**3))
    return reducing, round(cells * (face.vertex_block + 2 * face.side_block + functions)), cells * whole


def _kept_modes(case: Case, reduction: ReductionSettings, pitch: tuple[float, float], mesh: MeshCounts) -> float:
    """Fixed-interface modes expected up to the cut-off of a cell.

    A coarse cell gives their number. Where its elements are too large for them, the modal density does, limited by the
    growth of a volume's modes.
    """
    from pipeline.planning.model_choice import bands_end_hz, coarse_cell  # solves: a plan of a plate loads no solver

    coarse, top_hz = coarse_cell(case.design, case.bands.count), reduction.top_hz
    count = coarse.fixed_modes(top_hz)
    if coarse.resolves(count):
        return float(count)
    end_hz = min(bands_end_hz(case), top_hz)
    by_volume = coarse.fixed_modes(end_hz) * (top_hz / end_hz) ** 3
    return max(count, min(by_volume, fixed_modes(case.design, reduction, True, pitch, mesh)))


def _lattice(
    reducing: Cost, dof: int, whole: float, operations: float, solves: float, case: Case, choice: ModelChoice
) -> ResourceEstimate:
    """Estimate `solves` dense pencils at `operations` times `dof`^3 each, of cells with `whole` functions."""
    waves = WAVE_OPERATIONS * whole**2 * (case.bands.count + WAVES_ABOVE)
    dense = Cost(
        (Stage("solving the cell's dense pencils", DENSE_COPIES * 8.0 * dof**2),),
        solves * (operations * dof**3 + SOLVE_OPERATIONS + waves),
        dof,
    )
    return ResourceEstimate(reducing.then(dense), None, dof, change=_cell_changes(case, choice), cad=choice.kind != HEX)


def _meshed_cell(case: Case, choice: ModelChoice, wavevectors: int) -> ResourceEstimate:
    """Estimate the cell without reduction: the real embedding at a wavevector has twice the size."""
    assert choice.hexahedra
    mesh = of_boxes(cell_scene(case.design, choice.hexahedra), choice.hexahedra.order)
    fill = mesh.fill.times(4)
    solve = modal_solve(2.0 * mesh.dofs, EMBEDDED * 9.0 * mesh.pairs, fill, 2.0 * case.bands.count, True)
    split = Stage("splitting the cell by phases", SPLIT_BYTES * 9.0 * mesh.pairs)
    cost = assembly(mesh).then(Cost((split,))).then(solve, (SPLIT_KEPT + 24.0 * EMBEDDED) * 9.0 * mesh.pairs)
    return ResourceEstimate(
        Cost(cost.stages, assembly(mesh).operations + wavevectors * solve.operations, cost.dofs),
        float(case.bands.count),
        change=_cell_changes(case, choice),
    )


# -- what to change ----------------------------------------------------------------------------------------------------


def _changes(case: Case, choice: ModelChoice, query: Request) -> tuple[str, ...]:
    """Changes that make the modes of a part cheaper, the most effective first."""
    changes = [_coarser(case)]
    asked = query.band_hz or ((query.near_hz,) if query.near_hz else ())
    if asked and min(asked) >= HIGH_HZ:
        kilohertz = " to ".join(f"{each / KHZ:g}" for each in asked)
        changes.insert(0, f"divide by 1000 if Hz were meant ({kilohertz} kHz was requested)")
    if choice.model == SOLID and choice.part == "plate" and not case.design.outline:
        changes.insert(0, 'set solve.model = "superelement"')
    if choice.quarter and query.symmetry is None:
        changes.append("request one symmetry class")
    changes.append("request fewer modes (a lower count)" if query.band_hz is None else "narrow or lower the band")
    if choice.part == "plate" and pillar_count(case.design):
        changes.append("use fewer rows or a larger pitch")
    if query.part != "pillar" and case.design.is_short_wave:
        changes.append(
            "lower zone.nodal_lines: the half-wavelength of the target mode does not exceed the plate's thickness"
        )
    return tuple(changes)


def _cell_changes(case: Case, choice: ModelChoice) -> tuple[str, ...]:
    """Changes that make a unit cell cheaper."""
    changes = [_coarser(case), "use a stiffer or smaller pillar", "use a smaller pitch", "lower bands.count"]
    return tuple(['set solve.model = "superelement"', *changes] if choice.model == SOLID else changes)


def _coarser(case: Case) -> str:
    return f"raise solve.accuracy ({case.solve.accuracy:g})"
