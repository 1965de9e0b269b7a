"""Frequencies of a drawn scene beside a finer or an independent computation, and their stated bars: one function a part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Literal

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import cell_boxes, hex_mesh
from geometry.layout import Design, region_materials
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict, load_case
from pipeline.logs import TerminalLog
from pipeline.models.forced import forced_plate
from pipeline.models.modes import Request, solve_modes
from pipeline.models.parts import tet_cell
from pipeline.planning import mesh_rules
from pipeline.questions.bands import Bands
from pipeline.questions.question import Run, ask
from solvers.accuracy.bands import mesh_error
from solvers.accuracy.plate import mode_errors
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import modes_near
from solvers.piezo.peak_errors import frequency_errors
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.waves.bloch import BlochCell
from studies.bonded_solid import UNSURE, BondedPlate, solid_modes
from studies.ritz_blocks import free_block_hz
from studies.scenes_drawn import CASE

BANDS = 10
SLOWEST = 1e-3  # of the highest frequency: slower waves are rigid-body modes
ROUGHLY, FINELY = 0.01, 0.0005  # accuracies of lone parts
CUTOFF = 0.003  # accuracy for which the fixed-interface modes of cells are kept: none of any weight on one mesh alone
CLASS_MODES = 6  # of a plate's symmetry class
EXTENSION = 2.0  # of plates beyond their zone and rows, in thicknesses
TAPER = 0.6  # of tapered pillars: tip over foot
BLOCK_MODES, DEGREES = 12, (14, 13, 12)  # of free blocks, and polynomials along their edges
PATCH_MODES = 4  # that a patch in the middle drives
MISSING = inf  # error of a mode that a list lacks
QUIET = TerminalLog(True)


@dataclass(frozen=True)
class Compared:
    """Relative differences of a scene's frequencies from the finer computation, beside the stated bars, (k,) each.

    Where the other computation is no finer, its own bar is added.
    """

    part: str
    scene: str
    error: FloatArray
    bar: FloatArray

    @property
    def within(self) -> float:
        """Share of the frequencies within the bar."""
        return float((self.error <= self.bar).mean())


def described(scene: Design | BondedPlate) -> str:
    """A scene in a line."""
    if isinstance(scene, BondedPlate):
        size = " x ".join(f"{1e3 * each:.2f}" for each in scene.patch_m)
        return f"{described(scene.design)}, patch {size} mm on the {'back' if scene.is_on_back else 'touch face'}"
    if scene.pillar is None:
        size = " x ".join(f"{1e3 * each:.2f}" for each in (scene.length_m, 2.0 * scene.half_span_m, scene.thickness_m))
        return f"{scene.material.name} {size} mm"
    sizes = (scene.thickness_m, scene.pillar.base_m, scene.pillar.height_m, scene.pitch_x_m)
    plate, side, height, pitch = (f"{1e3 * size:.2f}" for size in sizes)
    return f"{scene.material.name} {plate} mm, {scene.pillar.material.name} {side} x {height} mm, pitch {pitch} mm"


def shaped(design: Design, shape: str) -> Design:
    """The design with pillars of another shape, as wide and as high."""
    assert design.pillar
    tip = (TAPER if shape == "tapered" else 1.0) * design.pillar.base_m
    return replace(design, pillar=replace(design.pillar, shape=shape, tip_m=tip))


def of_cells(design: Design, shape: str = "square", first: int = 0) -> Compared:
    """Ten bands at G, X, M and between, on the first mesh level, or on that of another number, and on the finest."""
    levels, design = list(mesh_rules.CELL_LEVELS.values()), shaped(design, shape)
    (rough, bar), (fine, _) = (_bands(design, _lattice(design, level)) for level in (levels[first], levels[-1]))
    name = "cell" if shape == "square" else f"{shape} cell"
    return Compared(f"{name}, second mesh" if first else name, described(design), np.abs(rough / fine - 1.0), bar)


def _bands(design: Design, lattice: ReducedLattice) -> tuple[FloatArray, FloatArray]:
    """Frequencies above those of rigid-body waves, and the half-widths of their bars by the mesh."""
    edge, tones, bars = np.pi / design.pitch_x_m, [], []
    for k in ((0.0, 0.0), (edge, 0.0), (edge, edge), (0.37 * edge, 0.61 * edge)):
        waves = lattice.waves(np.array(k), BANDS)
        moving = waves.frequency_hz > SLOWEST * waves.frequency_hz[-1]
        tones.append(waves.frequency_hz[moving])
        bars.append(mesh_error(lattice.cell, waves).half_width[moving])
    return np.concatenate(tones), np.concatenate(bars)


def _lattice(design: Design, level: mesh_rules.MeshLevel) -> ReducedLattice:
    reductions = Reductions(design.stack, design.pillar, _settings(design, level))
    return ReducedLattice(reductions.cell(lattice_panel(design)))


def _settings(design: Design, level: mesh_rules.MeshLevel) -> ReductionSettings:
    along = 4 if design.pitch_x_m <= 2.5 * design.thickness_m else 5
    top_hz = mesh_rules.lattice_reduction(design, CUTOFF).top_hz
    return ReductionSettings(Interface(along, 3), top_hz, mesh_rules.cell_mesh(design, level))


def of_whole_cell(design: Design) -> Compared:
    """Ten bands at G, X and M at accuracy 0.003 against the whole cell as meshed, without symmetry or reduction.

    What the whole cell's own mesh is off by is told by the reduced cell of the same mesh: what nested meshes take from it.
    """
    assert design.pillar
    fine = list(mesh_rules.CELL_LEVELS.values())[1]
    boxes = cell_boxes(design, mesh_rules.cell_mesh(design, fine))
    scale = Scale.of(design.thickness_m, design.stack.mean)
    system = assemble(hex_mesh(boxes, fine.order), region_materials(design.stack, design.pillar), scale)
    whole, same = BlochCell(system, design.lattice), _lattice(design, fine)
    ours, bar = _at_corners(design, 0.003)
    theirs = np.array([whole.frequencies(k, BANDS) for k in _corners(design)])
    own = [mesh_error(same.cell, same.waves(k, BANDS)) for k in _corners(design)]
    moving = theirs > SLOWEST * theirs.max()
    bars = bar + np.array([each.taken + each.half_width for each in own])
    return Compared("whole cell", described(design), np.abs(ours[moving] / theirs[moving] - 1.0), bars[moving])


def _corners(design: Design) -> FloatArray:
    """G, X and M."""
    return np.pi / design.pitch_x_m * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])


def of_tetrahedra(design: Design, shape: str) -> Compared:
    """Ten bands at G, X, M and between of a cell by tetrahedra as for accuracy 0.01, and by hexahedra one mesh level finer than
    the first.
    """
    design, level = shaped(design, shape), list(mesh_rules.CELL_LEVELS.values())[1]
    mesh, halved = tet_cell(design, mesh_rules.tet_cell_edge_m(design, ROUGHLY), QUIET)
    reductions = Reductions(design.stack, design.pillar, _settings(design, level), mesher=lambda panel: mesh)
    by_tetrahedra = ReducedLattice(reductions.cell(replace(lattice_panel(design), halved=halved)))
    (rough, bar), (fine, _) = _bands(design, by_tetrahedra), _bands(design, _lattice(design, level))
    return Compared(f"{shape} cell by tetrahedra", described(design), np.abs(rough / fine - 1.0), bar)


def _at_corners(design: Design, accuracy: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies (3, bands) at G, X and M as `antinode bands` gives them, and their bars by mesh and truncation."""
    settings = [f"solve.accuracy={accuracy}", "bands.points=1", f"bands.count={BANDS}"]
    case = load_case(CASE, settings)
    result = ask(replace(case, design=design), Bands(), Run(QUIET, detailed=False))
    assert np.allclose(result.wavevectors_per_m[:3], _corners(design))
    return result.frequencies_hz[:3], result.error[:3]


def of_part(part: str, design: Design, mesh: str = "auto", name: str = "") -> Compared:
    """The lowest modes of a lone part at two accuracies, the finer one by hexahedra."""
    (rough, bar), (fine, _) = (_modes(part, design, *each) for each in ((ROUGHLY, mesh), (FINELY, "auto")))
    return Compared(name or part, described(design), np.abs(rough / fine - 1.0), bar)


def _modes(part: str, design: Design, accuracy: float, mesh: str) -> tuple[FloatArray, FloatArray]:
    case: Case = load_case(CASE, [f"solve.accuracy={accuracy}", f"solve.mesh={mesh}"])
    rows = solve_modes(replace(case, design=design), Request(part, near_hz=0.0, count=6), QUIET).rows[:6]
    bars = np.array([row.error if row.error is not None else np.nan for row in rows])
    return np.array([row.frequency_hz for row in rows]), bars


def of_cell_command(name: str, design: Design) -> Compared:
    """Ten bands at G, X and M by `antinode bands` at two accuracies, all of their bars."""
    (rough, bar), (fine, _) = (_at_corners(design, accuracy) for accuracy in (ROUGHLY, 0.1 * ROUGHLY))
    moving = fine > SLOWEST * fine.max()
    return Compared(name, described(design), np.abs(rough[moving] / fine[moving] - 1.0), bar[moving])


def of_block(name: str, model: str, design: Design) -> Compared:
    """The lowest modes of a free block by `antinode modes` beside the Legendre-Ritz solution, class by class."""
    size_m = (design.length_m, 2.0 * design.half_span_m, design.thickness_m)
    exact = free_block_hz(design.material, size_m, inf, DEGREES)
    tones = np.sort(np.concatenate(list(exact.values())))
    high_hz = _in_a_gap(tones, BLOCK_MODES)
    case = replace(_bare_case(f"solve.model={model}"), design=design, patches=None)
    rows = solve_modes(case, Request("plate", (0.02 * tones[0], high_hz), search=False), QUIET).rows
    pairs = [
        paired(
            [
                (row.frequency_hz, np.nan if row.error is None else row.error)
                for row in rows
                if row.symmetry == symmetry
            ],
            own[own < high_hz],
        )
        for symmetry, own in exact.items()
    ]
    error, bar = (np.concatenate(each) for each in zip(*pairs, strict=True))
    return Compared(name, described(design), error, bar)


def _in_a_gap(tones: FloatArray, count: int) -> float:
    """A frequency in the widest of the gaps above about so many tones."""
    at = count - 1 + int(np.argmax(np.diff(np.log(tones[count - 1 : count + 3]))))
    return float(np.sqrt(tones[at] * tones[at + 1]))


def paired(ours: list[tuple[float, float]], theirs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Errors and bars in ascending order; what one list lacks is an error that no bar holds."""
    stated, both = np.array(sorted(ours)).reshape(-1, 2), min(len(ours), len(theirs))
    error, bar = np.full((2, max(len(ours), len(theirs))), [[MISSING], [1.0]])
    error[:both], bar[:both] = np.abs(stated[:both, 0] / theirs[:both] - 1.0), stated[:both, 1]
    return error, bar


def of_patch(scene: BondedPlate) -> Compared:
    """The lowest modes that a patch drives, as `antinode response` solves them, beside a solid with the whole potential."""
    material, length = scene.design.material, scene.design.length_m
    first_hz = scene.design.thickness_m / length**2 * np.sqrt(material.rod(0).young_pa / material.density_kg_m3)
    solid = solid_modes(scene, 2.5 * first_hz)
    high_hz = _in_a_gap(solid.frequency_hz, PATCH_MODES)
    case = _bare_case("solve.accuracy=0.003")
    assert case.patches
    face: Literal["back", "touch"] = "back" if scene.is_on_back else "touch"
    lengths = (scene.patch_m[0],)
    patches = replace(case.patches, size_m=scene.patch_m, face=face, centres_m=((0.0, 0.0),), lengths_m=lengths)
    forced = forced_plate(
        replace(case, design=scene.design, patches=patches), QUIET, (0.8 * solid.frequency_hz[0], high_hz)
    )
    basis = next(each for each in forced.modes if "SS" in each.group.symmetries)
    inside = basis.frequency_hz < high_hz
    ours = list(zip(basis.frequency_hz[inside], frequency_errors(basis).total[inside], strict=True))
    error, bar = paired(ours, solid.frequency_hz[solid.frequency_hz < high_hz])
    unsure = np.zeros(len(bar))
    unsure[: len(solid.frequency_step)] = UNSURE * solid.frequency_step[: len(bar)]
    return Compared("stiff patch", described(scene), error, bar + unsure)


def _bare_case(*settings: str) -> Case:
    """A bare plate with a patch, whose sizes stand for none."""
    return case_from_dict(
        {
            "name": "bare",
            "material": "aluminium",
            "plate": {"thickness_mm": 1.5},
            "zone": {"length_mm": 24.0, "width_mm": 10.0, "nodal_lines": 2},
            "array": {"rows": 0, "extension_mm": 4.0},
            "solve": {"accuracy": ROUGHLY},
            "patches": {"material": "pz26", "size_mm": [5.0, 3.0, 0.4], "face": "back", "centres_mm": [[0.0, 0.0]]},
        },
        None,
        settings,
    )


def of_plate(design: Design) -> Compared:
    """The lowest modes of a plate with a row of pillars on either side of its zone, on the first mesh level and on the finest,
    the elements of its bare panels half as long there.
    """
    levels = list(mesh_rules.CELL_LEVELS.values())
    design = replace(design, rows=1, extension_m=EXTENSION * design.thickness_m)
    (rough, bar), (fine, _) = _plate_modes(design, levels[0], 1.0), _plate_modes(design, levels[-1], 0.5)
    return Compared("plate", described(design), np.abs(rough / fine - 1.0), bar)


def _plate_modes(design: Design, level: mesh_rules.MeshLevel, shrunk: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies of every symmetry class's lowest modes, and the half-widths of their bars by the mesh."""
    mesh = mesh_rules.cell_mesh(design, level)
    bare_m = mesh_rules.bare_size_m(design, mesh.order)
    assert bare_m
    settings = mesh_rules.plate_reduction(design, ROUGHLY, mesh_rules.target_window_hz(design)[1])
    settings = replace(settings, hexahedra=mesh, bare_size_m=shrunk * bare_m)
    model = PlateModel(design, Reductions(design.stack, design.pillar, settings))
    tones, bars = [], []
    for symmetry in model.symmetries:
        modes = modes_near(pencil := model.pencil(symmetry), 0.0, CLASS_MODES)
        tones.append(modes.frequency_hz[:CLASS_MODES])
        bars.append(mode_errors(model.assembled(symmetry), pencil, modes.vectors).mesh[:CLASS_MODES])
    return np.concatenate(tones), np.concatenate(bars)
