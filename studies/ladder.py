"""Results in hertz of every model and mesh of the ladder for the parts of the reference design."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import cell_boxes, hex_mesh, panel_boxes, pillar_boxes, plate_boxes, zone_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.mesh import Mesh, check_mesh
from geometry.tet import scenes
from geometry.tiling import Panel, lattice_panel
from pipeline.case.model import load_case
from pipeline.paths import STUDIES
from pipeline.planning import mesh_rules
from solvers.analytic.predesign import pillar_frequencies_hz, predesign
from solvers.fem.assembly import System, assemble
from solvers.fem.eigen import modes_in_band, modes_near
from solvers.fem.solid import CLASSES, SolidModel, constrain, free_mask
from solvers.measures.confinement import Weighed, measure, target_symmetry
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.waves.bloch import BlochCell

WINDOW_HZ = (30e3, 38e3)  # where the target mode of the plate is looked for
SMALL = 1e-6  # an error to which a confinement answers in proportion
ZONE = {"zone": 0, "zone two lines up": 2, "zone four lines up": 4}  # nodal lines beyond the target mode's
EXTRAPOLATED = "extrapolated"  # the model of a superelement whose discretisation error coarser meshes correct
ALIKE = 0.5  # modal assurance of a mode with the shape it is called after: a coarse mesh may have none
BENDING = ("pillar", "second bending", "third bending")
WHOLE_BENDING = [0, 3, 7]  # among all modes: every bending twice, with a twist, a stretch and a twist between
Values = dict[str, float]


@cache
def design() -> Design:
    """The reference design: three rows, p = 4 mm."""
    return load_case(STUDIES / "three-rows.toml").design


def plate_design() -> Design:
    """The yardstick plate: one row and 5 mm."""
    return replace(design(), rows=1, extension_m=5e-3)


def materials() -> dict[str, Any]:
    """One material for every region."""
    return dict.fromkeys(("plate", "pillar", "body"), design().material)


def settings(mesh_level: dict[str, Any]) -> HexSettings:
    """Hexahedra of a mesh level; sizes in mm."""
    along = 1e-3 * mesh_level.get("along_mm", mesh_level["size_mm"])
    layers, factor, through = mesh_level.get("layers", 0), mesh_level.get("factor", 0.15), mesh_level.get("through", 1)
    return HexSettings(mesh_level["order"], 1e-3 * mesh_level["size_mm"], layers, factor, along, through)


def of_the_planner(part: str, row: mesh_rules.MeshLevel) -> dict[str, Any]:
    """A mesh level with the very elements that the planner gives the part."""
    mesh = {"zone": mesh_rules.zone_mesh, "pillar": mesh_rules.pillar_mesh}.get(part, mesh_rules.cell_mesh)(
        design(), row
    )
    mesh_level = asdict(row) | {"size_mm": 1e3 * mesh.size_m}
    return mesh_level | ({"along_mm": 1e3 * mesh.pillar_size_m} if mesh.pillar_size_m else {})


def of_order(mesh: Mesh, order: int) -> Mesh:
    """Quadratic tetrahedra as they are, or their corners alone."""
    if order == mesh.order:
        return mesh
    used, cells = np.unique(mesh.cells[:, :4], return_inverse=True)
    number = np.full(len(mesh.nodes), -1)
    number[used] = np.arange(len(used))
    faces = {name: number[face[:, :3]] for name, face in mesh.faces.items()}
    return Mesh(mesh.nodes[used], cells.reshape(-1, 4), "tet", 1, mesh.regions, faces)


def zone(mesh_level: dict[str, Any]) -> tuple[Values, int]:
    """The bare strip, sides clamped: modes (0, N), (0, N + 2) and (0, N + 4), whose waves are shorter."""
    d = design()
    if mesh_level["model"] == "analytic":
        return {"zone": float(getattr(predesign(d).zone, mesh_level["theory"]))}, 0
    if mesh_level["model"] == "tet":
        mesh = of_order(scenes.tet_zone(d, 1e-3 * mesh_level["size_mm"], "xy"), mesh_level["order"])
    else:
        mesh = hex_mesh(zone_boxes(d, settings(mesh_level)), mesh_level["order"])
    model = SolidModel(check(mesh), materials(), ("y+",), True)
    pencil = model.pencil(target_symmetry(d.nodal_lines))
    modes = modes_near(pencil, 50e3, 6)
    touch = model.touch("SS", modes.vectors)
    like = [measure(touch, replace(d, nodal_lines=d.nodal_lines + more), "SS").mac for more in ZONE.values()]
    quantities = {name: modes.frequency_hz[mac > ALIKE] for name, mac in zip(ZONE, like, strict=True)}
    return {name: float(hz[0]) for name, hz in quantities.items() if len(hz)}, pencil.dof


def pillar(mesh_level: dict[str, Any]) -> tuple[Values, int]:
    """The lone pillar, foot clamped: first, second and third bending."""
    d = design()
    assert d.pillar
    if mesh_level["model"] == "analytic":
        return _bending(pillar_frequencies_hz(d.pillar, mesh_level["theory"], 3)), 0
    if mesh_level["model"] == "tet":
        mesh = of_order(scenes.tet_pillar(d.pillar, 1e-3 * mesh_level["size_mm"]), mesh_level["order"])
        pencil = SolidModel(check(mesh), materials(), ("foot",), False).pencil(None)
        hz = modes_near(pencil, 0.0, WHOLE_BENDING[-1] + 1).frequency_hz
        return _bending(hz[WHOLE_BENDING if mesh_level["order"] > 1 else WHOLE_BENDING[:1]]), pencil.dof
    mesh = hex_mesh(pillar_boxes(d.pillar, settings(mesh_level)), mesh_level["order"])
    pencil = SolidModel(check(mesh), materials(), ("touch",), True).pencil("AS")
    return _bending(modes_near(pencil, 0.0, len(BENDING)).frequency_hz), pencil.dof


def _bending(hz: FloatArray) -> Values:
    return {name: float(each) for name, each in zip(BENDING, hz, strict=False)}


def points() -> dict[str, FloatArray]:
    """Gamma, X and M of the square lattice, rad/m."""
    return {label: design().lattice.high_symmetry[label] for label in "GXM"}


def band_values(rows: dict[str, FloatArray]) -> Values:
    """The quantities followed: the pillars' bending at M and Gamma, the first band at X, the edges of the gap."""
    return {quantity: float(rows[point][bands].mean()) for quantity, (point, bands) in FOLLOWED.items()}


def cell(mesh_level: dict[str, Any]) -> tuple[Values, int]:
    """The unit cell at Gamma, X and M: fully meshed, reduced, or its quarter between mirrors."""
    d = design()
    if mesh_level["model"] == "quarter":
        return _quarter_cell(mesh_level)
    if mesh_level["model"] == "solid":
        bloch = BlochCell(
            assemble(check(hex_mesh(cell_boxes(d, settings(mesh_level)), mesh_level["order"])), materials()), d.lattice
        )
        return band_values({name: bloch.frequencies(k, 8) for name, k in points().items()}), bloch.dof
    reduction = replace(mesh_rules.lattice_reduction(d, 0.002), hexahedra=settings(mesh_level))
    lattice = ReducedLattice(_reductions(d, reduction, mesh_level).cell(lattice_panel(d)))
    return band_values({name: lattice.frequencies(k, 8) for name, k in points().items()}), lattice.cell.mesh_dof


def _reductions(d: Design, reduction: ReductionSettings, mesh_level: dict[str, Any]) -> Reductions:
    """Panels of a mesh level; coarser meshes correct the discretisation error of an extrapolated one."""
    mesher: Callable[[Panel], Mesh] | None = None
    if mesh_level["model"] == "superelement tet":
        mesh = check(of_order(scenes.tet_cell(d, 1e-3 * mesh_level["size_mm"], "xy"), mesh_level["order"]))
        mesher = lambda _: mesh  # noqa: E731
    elif mesh_level["model"] == "superelement":
        hexahedra = settings(mesh_level)
        mesher = lambda panel: hex_mesh(  # noqa: E731
            panel_boxes(panel, d.stack, d.pillar, hexahedra), hexahedra.order
        )
    return Reductions(d.stack, d.pillar, reduction, None, mesher)


POINTS = {"G": (1, 1), "X": (-1, 1), "M": (-1, -1)}  # phases over one pitch
FOLLOWED = {  # point and bands from 0, whose mean is taken
    "bending at M": ("M", slice(0, 2)),
    "bending at G": ("G", slice(3, 5)),
    "first at X": ("X", slice(0, 1)),
    "gap lower edge": ("M", slice(5, 6)),
    "gap upper edge": ("G", slice(6, 7)),
}


def _quarter_cell(mesh_level: dict[str, Any]) -> tuple[Values, int]:
    """Quarter cell for phases of 1 or -1: a wave stands between mirrors, its sign at x+ is that at x- times the phase.

    A coarse mesh shows in which symmetry class each quantity is, and as which of its modes; the fine one solves no other.
    """
    places = _classes_of_quantities()
    mesh = check(hex_mesh(cell_boxes(design(), settings(mesh_level), True), mesh_level["order"]))
    system = assemble(mesh, materials())
    values = {
        quantity: float(_standing(system, symmetry, point, index + 1)[index])
        for quantity, (symmetry, point, index) in places.items()
    }
    return values, 3 * len(mesh.nodes)


def _standing(system: System, symmetry: str, point: str, count: int) -> FloatArray:
    """The lowest frequencies of one symmetry class at a point, rigid-body modes as zeros."""
    far = [sign if flip > 0 else "SA".replace(sign, "") for sign, flip in zip(symmetry, POINTS[point], strict=True)]
    planes = {"x-": symmetry[0], "y-": symmetry[1], "x+": far[0], "y+": far[1]}
    pencil = constrain(system, free_mask(system.mesh, (), planes))
    elastic = modes_near(pencil, 0.0, max(count - pencil.rigid_count, 1)).frequency_hz
    return np.concatenate([np.zeros(pencil.rigid_count), elastic])


@cache
def _classes_of_quantities() -> dict[str, tuple[str, str, int]]:
    """{quantity: (symmetry class, point, which mode of the class)}."""
    coarse = {"order": 3, "size_mm": 2.0, "along_mm": 3.15}
    system = assemble(hex_mesh(cell_boxes(design(), settings(coarse), True), 3), materials())
    quantities: dict[str, list[tuple[float, str, int]]] = {
        point: sorted(
            (float(f), symmetry, i) for symmetry in CLASSES for i, f in enumerate(_standing(system, symmetry, point, 5))
        )
        for point in POINTS
    }
    found = {quantity: (point, quantities[point][bands.start]) for quantity, (point, bands) in FOLLOWED.items()}
    return {quantity: (symmetry, point, index) for quantity, (point, (_, symmetry, index)) in found.items()}


def plate(mesh_level: dict[str, Any]) -> tuple[Values, int]:
    """One row and 5 mm: the target mode, its confinement (dB), and the sensitivity of that to an error, dB over
    the error.
    """
    d, symmetry = plate_design(), target_symmetry(design().nodal_lines)
    if mesh_level["model"] == "analytic":
        return {"plate": float(getattr(predesign(d).zone, mesh_level["theory"]))}, 0
    if mesh_level["model"] in ("superelement", EXTRAPOLATED):
        bare = mesh_rules.bare_size_m(d, mesh_level["order"]) if "share" in mesh_level else None
        reduction = ReductionSettings(
            Interface(*mesh_level["degrees"]),
            mesh_level["modes_over_band"] * WINDOW_HZ[1],
            settings(mesh_level),
            6e-3,
            bare,
        )
        model: Any = PlateModel(d, _reductions(d, reduction, mesh_level))
    elif mesh_level["model"] == "tet":
        mesh = of_order(scenes.tet_plate(d, 1e-3 * mesh_level["size_mm"], True), mesh_level["order"])
        model = SolidModel(check(mesh), materials(), (), True, d.touch_lines_m)
    else:
        mesh = hex_mesh(plate_boxes(d, settings(mesh_level)), mesh_level["order"])
        model = SolidModel(check(mesh), materials(), (), True, d.touch_lines_m)
    pencil = model.pencil(symmetry)
    modes = modes_in_band(pencil, *WINDOW_HZ)
    measures = measure(model.touch(symmetry, modes.vectors), d, symmetry)
    assert measures.zone_share is not None and measures.confinement_db is not None
    best = int(np.argmax(measures.mac * measures.zone_share))
    overlaps = Weighed.over([model.touch(symmetry, modes.vectors)], d).overlaps[0]
    assert overlaps
    most = overlaps.mixing_db(modes.frequency_hz, best, SMALL)
    values = {"plate": float(modes.frequency_hz[best]), "confinement (dB)": float(measures.confinement_db[best])}
    return values | {"mixing (dB)": most / SMALL}, pencil.dof


def check(mesh: Mesh) -> Mesh:
    """The mesh, once its Jacobians, nodes and volume stand the checks."""
    check_mesh(mesh)
    return mesh


PARTS = {"zone": zone, "pillar": pillar, "cell": cell, "plate": plate}
