"""The demand of each step of a plan, from the design and its models alone: nothing is meshed, assembled or reduced."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from math import ceil, floor

from geometry.hex.box_counts import BoxCounts, box_counts
from geometry.hex.boxes import HexSettings, Piece, Scene, cell_scene, piece_scene, pillar_scene, plate_scene, zone_scene
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import HEX, SOLID, Way, way_of
from pipeline.planning.request import Request, model_high_hz
from pipeline.planning.resources import Demand, refuse
from solvers.analytic.mode_density import highest_hz, pillar_modes, plate_modes
from solvers.fem.dissection import Fill, grid_fill, nodal, panelled
from solvers.fem.solve_cost import Cost, MeshCounts, Stage, assembly, modal_solve, solid_modes
from solvers.superelement.build import Recipe
from solvers.superelement.interface import Interface
from solvers.superelement.tiling import grid

MOST_LINES = 2_000_000  # of a plate's grid: more are not even drawn to be counted
MANY_FUNCTIONS = 1000  # of one cell or panel: some 300 are common
LATTICE_DOF = 400  # unknowns a wavevector that a cell may be refined to (lattice_cell.MOST_DOF)
DENSE_COPIES = 34  # of a lattice's matrices: nine steps of K and of M, and what one wavevector takes
DENSE_OPERATIONS = 2.0  # of a dense eigen-solve over n^3
GAP_SOLVES = 70  # wavevectors that edges of gaps take beside the path's
JOINING_BYTES = 45.0  # an entry of a panel's matrices while they are summed
PANEL_OPERATIONS = 2e6  # worth of time to number a panel's unknowns
TETRAHEDRA = 10.0  # times volume over edge cubed, graded edges included
NODES, PAIRS = 1.45, 28.0  # a quadratic tetrahedron's nodes; nodes that share an element with one
TET_FILL = 4.0  # entries of the factor over n^(4/3)
SKIN = 0.4  # of a piece's nodes that lie on its surface
EMBEDDED = 2.2  # entries of the real embedding over those of the cell
SPLIT_BYTES, SPLIT_HELD = 70.0, 16.0  # an entry, while the cell is split by phases, and afterwards

Kind = tuple[
    MeshCounts, float, int
]  # a kind of piece: its mesh, its fixed-interface modes, how many of it make the piece


def announce(what: str, demand: Demand, log: Log) -> None:
    """Tell a computation's demand before it begins, and what of it is out of proportion. InputFault where it cannot fit."""
    refuse({what: demand})
    log.info(demand.text())
    if demand.functions and demand.functions > MANY_FUNCTIONS:
        log.alarm(
            "MANY_FUNCTIONS",
            f"the reduction keeps about {demand.functions} functions {demand.a_what} for {what}: its modes are kept up to a "
            "frequency that the plate sets, where waves in so soft or large a pillar are short; expect much time and memory",
        )


# -- bodies ------------------------------------------------------------------------------------------------------------


def of_boxes(scene: Scene, order: int) -> MeshCounts:
    """A mesh of boxes and its fill."""
    counts = box_counts(scene, order)
    return MeshCounts(counts.elements, (order + 1) ** 3, counts.nodes, counts.pairs, _box_fill(counts))


def _box_fill(counts: BoxCounts) -> Fill:
    """The body's fill and every pillar's, whose foot belongs to the body."""
    total, unknowns = grid_fill(counts.body, nodal(counts.order)), nodal(counts.order)
    ends = ((True, True), (True, True), (False, True))
    for nx, columns in Counter(counts.columns).items():
        for ny, rows in Counter(counts.rows).items():
            total += grid_fill((nx, ny, counts.up), unknowns, ends).times(columns * rows)
    return total


def of_tetrahedra(volume_m3: float, edge_m: float) -> MeshCounts:
    """Quadratic tetrahedra of about an edge length; their number is the mesher's."""
    elements = TETRAHEDRA * volume_m3 / edge_m**3
    nodes = NODES * elements
    entries = TET_FILL * (3.0 * nodes) ** (4.0 / 3.0)
    return MeshCounts(elements, 10, nodes, PAIRS * nodes, Fill(entries, entries**1.5, entries))


# -- lone parts and plates meshed whole --------------------------------------------------------------------------------


def of_modes(case: Case, way: Way, asked: Request) -> Demand:
    """Modes of a part by its way."""
    high, total = _window(case, way, asked)
    if asked.count is not None and not asked.band_hz and way.part != "plate" and way.kind == HEX:
        way = way_of(case, way.part, max(high, model_high_hz(case, asked)))
    classes = 1 if asked.parity else len(way.classes)
    each = total if not way.mirrored else total / 4.0
    near = asked.band_hz is None
    each = float(asked.count) if near and asked.count is not None else each
    change = _changes(case, way, asked)
    if way.recipe is not None:
        return _joined(case, way, way.recipe, classes, each, near, change)
    body = _body(case, way)
    each = min(each, body.unknowns)
    shown = min(each, total) if near else classes * each
    return Demand(solid_modes(body, classes, each, near), shown, change=change, cad=way.kind != HEX)


def of_response(case: Case, way: Way, band_hz: tuple[float, float], frequencies: int) -> Demand:
    """Every class of the joined plate with its modes about a band, summed at so many frequencies."""
    from solvers.piezo.forced import MARGIN

    reach = (MARGIN[0] * band_hz[0], MARGIN[1] * band_hz[1])
    demand = of_modes(case, way, Request("plate", reach))
    modes = demand.modes or 0.0
    summing = Cost((), 100.0 * modes**2 * frequencies)
    return replace(demand, cost=demand.cost.then(summing))


def of_meshed_whole(case: Case, accuracy: float, count: int) -> Demand:
    """A few modes of the plate meshed whole by tetrahedra, of one mirror class."""
    whole = replace(case, solve=replace(case.solve, mesh="tet", model=SOLID, accuracy=accuracy))
    asked = Request(
        "plate", near_hz=mesh_rules.wanted_window_hz(case.design)[0], count=count, parity=case.parity_wanted
    )
    return of_modes(whole, way_of(whole, "plate", model_high_hz(whole, asked)), asked)


def _window(case: Case, way: Way, asked: Request) -> tuple[float, float]:
    """Up to where modes are looked for, Hz, and how many of a whole part are expected there."""

    def below(frequency_hz: float) -> float:
        return part_modes(case.design, way.part, frequency_hz)

    if asked.band_hz:
        low, high = asked.band_hz
        return high, max(0.0, below(high) - below(low))
    near, count = asked.near_hz or 0.0, float(asked.count or 0)
    high = highest_hz(below(near) + count / 2.0 if near else count, below, max(near, 1.0))
    return high, count


def part_modes(design: Design, part: str, frequency_hz: float) -> float:
    """Modes of a whole part below a frequency."""
    if part == "pillar":
        assert design.pillar
        return pillar_modes(frequency_hz, design.pillar)
    if part == "zone":
        held = 2.0 * design.length_m
        return plate_modes(frequency_hz, design.length_m, design.width_m, design.thickness_m, design.material, held)
    across = 2.0 * design.half_span_m
    plate = plate_modes(frequency_hz, design.length_m, across, design.thickness_m, design.material)
    pillars = pillar_count(design)
    return plate + (pillars * pillar_modes(frequency_hz, design.pillar) if pillars and design.pillar else 0.0)


def pillar_count(design: Design) -> int:
    """Pillars of the plate, without listing them."""
    if not (design.pillar and design.rows):
        return 0
    return 2 * design.rows * (floor((design.length_m - design.footprint_m) / design.pitch_x_m + 1e-6) + 1)


def _body(case: Case, way: Way) -> MeshCounts:
    """The mesh of a part solved as it is."""
    design = case.design
    if way.kind != HEX:
        assert way.edge_m
        return of_tetrahedra(
            _volume_m3(design, way.part) / (4.0 if way.mirrored and way.part != "pillar" else 1.0), way.edge_m
        )
    assert way.hexahedra
    if way.part == "pillar":
        assert design.pillar
        return of_boxes(pillar_scene(design.pillar, way.hexahedra), way.hexahedra.order)
    if way.part == "plate" and pillar_count(design) > MOST_LINES:
        return _many_pillars(design, way.hexahedra)
    scene = (zone_scene if way.part == "zone" else plate_scene)(design, way.hexahedra)
    return of_boxes(scene, way.hexahedra.order)


def _many_pillars(design: Design, settings: HexSettings) -> MeshCounts:
    """A plate with more pillars than are counted one by one: as many cells."""
    cell = of_boxes(cell_scene(design, settings), settings.order)
    many = pillar_count(design) / 4.0
    return MeshCounts(
        many * cell.elements, cell.corners, many * cell.nodes, many * cell.pairs, cell.fill.times(round(many))
    )


def _volume_m3(design: Design, part: str) -> float:
    pillar = design.pillar
    one = pillar.section_area_m2 * pillar.height_m if pillar else 0.0
    if part == "pillar":
        return one
    if part == "cell":
        return design.pitch_x_m * design.pitch_y_m * design.thickness_m + one
    if part == "zone":
        return design.length_m * design.width_m * design.thickness_m
    return design.length_m * 2.0 * design.half_span_m * design.thickness_m + pillar_count(design) * one


# -- reduced pieces and what is joined of them -------------------------------------------------------------------------


def _joined(
    case: Case, way: Way, recipe: Recipe, classes: int, modes: float, near: bool, change: tuple[str, ...]
) -> Demand:
    """A plate joined from reduced pieces: the costliest kind of piece, then the joined classes."""
    design = case.design
    nx, ny = _panels(design, recipe)
    kinds = _pieces(design, recipe, way)
    inner = max(functions for _, functions, _ in kinds)
    mean = _mean_functions(design, kinds, nx * ny)
    reducing = Cost()
    for body, functions, copies in kinds:
        reducing = reducing.then(_reduction(body, recipe.interface, functions, copies))
    across = (ceil(nx / 2), ceil(ny / 2)) if way.mirrored else (nx, ny)
    face = recipe.interface
    fill = grid_fill(across, panelled(face.vertex_block, face.side_block, mean))
    count = across[0] * across[1]
    entries = count * (face.count + mean) ** 2
    unknowns = count * (face.vertex_block + 2 * face.side_block + mean)
    modes = min(modes, unknowns)
    kept = len(kinds) * 24.0 * (face.count + inner) ** 2
    joining = Stage("joining the panels", JOINING_BYTES * entries)
    solve = modal_solve(unknowns, entries, fill, modes, near)
    cost = reducing.then(Cost((joining,), classes * PANEL_OPERATIONS * nx * ny), kept)
    held = kept + 3.0 * 12.0 * entries + (classes - 1) * 8.0 * unknowns * modes
    for _ in range(classes):
        cost = cost.then(solve, held)
    return Demand(cost, modes if near else classes * modes, round(face.count + inner), nx * ny, change, way.kind != HEX)


def _panels(design: Design, recipe: Recipe) -> tuple[int, int]:
    """Pieces along x and y."""
    bare = design.length_m / recipe.longest_m, 2.0 * design.half_span_m / recipe.longest_m
    many = pillar_count(design)
    if many > MOST_LINES or max(bare) > MOST_LINES:
        columns = many / (2 * design.rows) if design.rows else 0.0
        return ceil(max(columns, bare[0] if not columns else 0.0)), 2 * design.rows + ceil(bare[1])
    x, y = grid(design, recipe.longest_m)
    return len(x) - 1, len(y) - 1


def _pieces(design: Design, recipe: Recipe, way: Way) -> list[Kind]:
    """The mesh of each kind of piece, the largest of its kind, and its fixed-interface modes."""
    longest = recipe.longest_m
    bare_m = (design.pitch_x_m if design.rows else longest, longest)
    settings = recipe.hexahedra
    bare = Piece((-bare_m[0] / 2.0, -bare_m[1] / 2.0), (bare_m[0] / 2.0, bare_m[1] / 2.0), None, (0, 1))
    mesh = of_boxes(
        piece_scene(bare, design.thickness_m, None, replace(settings, size_m=recipe.bare_size_m or settings.size_m)),
        settings.order,
    )
    kinds: list[Kind] = [(mesh, fixed_modes(design, recipe, False, bare_m, mesh), 4)]
    if design.pillar and design.rows:
        pitch = (design.pitch_x_m, design.pitch_y_m)
        halves = ((0, 1), (1,)) if way.mirrored else ((),)
        kinds += [_pillar_piece(design, recipe, way, pitch, halved) for halved in halves]
    return kinds


def _pillar_piece(
    design: Design, recipe: Recipe, way: Way, pitch: tuple[float, float], halved: tuple[int, ...]
) -> Kind:
    low, high = (-pitch[0] / 2.0, -pitch[1] / 2.0), (pitch[0] / 2.0, pitch[1] / 2.0)
    if way.kind != HEX:
        assert way.edge_m
        mesh = of_tetrahedra(_volume_m3(design, "cell") / 2 ** len(halved), way.edge_m)
    else:
        piece = Piece(low, high, (0.0, 0.0) if design.pillar else None, halved)
        mesh = of_boxes(piece_scene(piece, design.thickness_m, design.pillar, recipe.hexahedra), recipe.hexahedra.order)
    return mesh, fixed_modes(design, recipe, bool(design.pillar), pitch, mesh), 2 ** len(halved)


def fixed_modes(design: Design, recipe: Recipe, foot: bool, size_m: tuple[float, float], mesh: MeshCounts) -> float:
    """Fixed-interface modes that a piece keeps, no more than its mesh can have."""
    rim = 2.0 * sum(size_m)
    count = plate_modes(recipe.top_hz, *size_m, design.thickness_m, design.material, rim)
    if foot and design.pillar:
        count += pillar_modes(recipe.top_hz, design.pillar)
    return min(count, 0.8 * mesh.unknowns)


def _mean_functions(design: Design, kinds: list[Kind], panels: int) -> float:
    """Fixed-interface modes of an average piece."""
    share = min(1.0, pillar_count(design) / max(panels, 1))
    return share * kinds[-1][1] + (1.0 - share) * kinds[0][1]


def _reduction(mesh: MeshCounts, face: Interface, functions: float, copies: int) -> Cost:
    """One piece reduced, `copies` times as large as its mesh: matrices, constraint shapes and fixed-interface modes."""
    surface = 2.0 * SKIN * copies * mesh.unknowns * 8.0 * (face.count + functions)
    shapes = 8.0 * mesh.unknowns * (face.count + functions)
    held = mesh.mesh_bytes + 2.0 * 9.0 * 12.0 * mesh.pairs
    solve = modal_solve(mesh.unknowns, 9.0 * mesh.pairs, mesh.fill, functions / 2.0)
    shaping = Stage("projecting a reduced cell", held + 4.0 * shapes + surface + 24.0 * (face.count + functions) ** 2)
    operations = 6.0 * mesh.unknowns * (face.count + functions) ** 2
    first = assembly(mesh).then(solve, held + 12.0 * 9.0 * mesh.pairs)
    return first.then(Cost((shaping,), operations))


# -- unit cells --------------------------------------------------------------------------------------------------------


def of_bands(case: Case, way: Way, wavevectors: int) -> Demand:
    """Bands at so many wavevectors."""
    if way.recipe is None:
        return _meshed_cell(case, way, wavevectors)
    solves = wavevectors + GAP_SOLVES + (case.bands.grid + 1) ** 2
    reducing, functions = _reduced_cell(case, way, way.recipe)
    return _lattice(reducing, functions, DENSE_OPERATIONS * solves, case, way)


def of_attenuation(case: Case, way: Way, frequencies: int) -> Demand:
    """Complex bands at so many frequencies; the bare cell is reduced too."""
    assert way.recipe
    reducing, functions = _reduced_cell(case, way, way.recipe)
    return _lattice(reducing, functions, 2.0 * DENSE_OPERATIONS * frequencies, case, way)


def _reduced_cell(case: Case, way: Way, recipe: Recipe) -> tuple[Cost, int]:
    """The unit cell's reduction, and its unknowns a wavevector."""
    design, face = case.design, recipe.interface
    pitch = (design.pitch_x_m, design.pitch_y_m)
    halved = (0, 1) if design.pillar is None or design.pillar.is_own_image else ()
    mesh, functions, copies = _pillar_piece(design, recipe, way, pitch, halved)
    functions = max(functions, LATTICE_DOF / 2.0)
    reducing = _reduction(mesh, face, functions, copies)
    return reducing, round(face.vertex_block + 2 * face.side_block + functions)


def _lattice(reducing: Cost, dof: int, operations: float, case: Case, way: Way) -> Demand:
    """Dense pencils of so many unknowns, `operations` times their cube."""
    dense = Cost((Stage("solving the cell's dense pencils", DENSE_COPIES * 8.0 * dof**2),), operations * dof**3, dof)
    return Demand(reducing.then(dense), None, dof, change=_cell_changes(case, way), cad=way.kind != HEX)


def _meshed_cell(case: Case, way: Way, wavevectors: int) -> Demand:
    """The cell as meshed: at a wavevector the real embedding, of twice the size."""
    assert way.hexahedra
    mesh = of_boxes(cell_scene(case.design, way.hexahedra), way.hexahedra.order)
    fill = mesh.fill.times(4)
    solve = modal_solve(2.0 * mesh.unknowns, EMBEDDED * 9.0 * mesh.pairs, fill, 2.0 * case.bands.count, True)
    split = Stage("splitting the cell by phases", SPLIT_BYTES * 9.0 * mesh.pairs)
    cost = assembly(mesh).then(Cost((split,))).then(solve, (SPLIT_HELD + 24.0 * EMBEDDED) * 9.0 * mesh.pairs)
    return Demand(
        Cost(cost.stages, assembly(mesh).operations + wavevectors * solve.operations, cost.unknowns),
        float(case.bands.count),
        change=_cell_changes(case, way),
    )


# -- what to change ----------------------------------------------------------------------------------------------------


def _changes(case: Case, way: Way, asked: Request) -> tuple[str, ...]:
    """What makes the modes of a part cheaper, the most effective first."""
    found = [_coarser(case)]
    if way.model == SOLID and way.part == "plate":
        found.insert(0, 'take solve.model = "superelement"')
    if way.mirrored and asked.parity is None:
        found.append("ask for one mirror class")
    found.append("ask for fewer modes (a lower count)" if asked.band_hz is None else "narrow or lower the band")
    if way.part == "plate" and pillar_count(case.design):
        found.append("take fewer rows or a larger pitch")
    if asked.part != "pillar" and case.design.is_short_wave:
        found.append("take fewer zone.nodal_lines: half a wave of the wanted mode is no longer than the plate is thick")
    return tuple(found)


def _cell_changes(case: Case, way: Way) -> tuple[str, ...]:
    """What makes a unit cell cheaper."""
    found = [_coarser(case), "take a stiffer or smaller pillar", "a smaller pitch", "or fewer bands.points"]
    return tuple(['take solve.model = "superelement"', *found] if way.model == SOLID else found)


def _coarser(case: Case) -> str:
    return f"raise solve.accuracy ({case.solve.accuracy:g})"
