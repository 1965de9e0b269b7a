"""Models of the plate, the isolated zone and the isolated pillar, of boxes or tetrahedra, and warnings about their meshes.

A coarse mesh first estimates the highest mode around a frequency and the number of modes per symmetry class. They select the
mesh and the number of modes to request from each class. Results are always counted on the finer mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh, interpolation, part_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials
from geometry.mesh import AnyMesh, Mesh, check_mesh
from geometry.supports import has_dampers, is_held_disc
from geometry.tiling import Panel
from pipeline.case.model import Case
from pipeline.case.supports import dents
from pipeline.logs import Log, TerminalLog
from pipeline.models.cell_cache import CellCache, MatrixCache
from pipeline.models.prestress import load_with_stress
from pipeline.planning import resource_estimate, simplifications
from pipeline.planning.model_choice import SOLID, ModelChoice, Request, model_choice_of
from pipeline.records import store
from pipeline.records.record import MeshRecord
from solvers.accuracy.mesh import (
    CoarserMeshes,
    ErrorFractions,
    LowerOrders,
    Nested,
    StressRecovery,
    clamped_shares,
    rim_shares,
)
from solvers.analytic.predesign import predesign
from solvers.errors import CountMismatch, SolverError
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil, modes_near
from solvers.fem.solid import SolidModel
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField
from solvers.plates.assembled import PlateModel, Reductions

MeshErrorSource = CoarserMeshes | LowerOrders | StressRecovery
LOCKING = 0.45  # Poisson's ratio


class PartModel(Protocol):
    """A body whose modes are solved symmetry class by symmetry class."""

    name: str
    symmetries: tuple[str | None, ...]

    @property
    def scale(self) -> Scale:
        """Units of the pencils."""
        ...

    def pencil(self, symmetry: str | None) -> PlainPencil:
        """K and M of a class."""
        ...

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        ...

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Pillars' share of the kinetic energy."""
        ...

    def lost(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Loss between motions."""
        ...

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
        """Outer surface."""
        ...


def mesh_record(what: str, mesh: AnyMesh) -> MeshRecord:
    """Check a mesh and describe it for the record; MeshError if it is invalid."""
    own = {"kind": mesh.kind, "order": mesh.order, "dof": mesh.dof, "sha256": mesh.sha256}
    return MeshRecord.of(check_mesh(mesh), what=what, volume_error=None, **own)


def build(case: Case, part: str, high_hz: float, log: Log, meshes: list[MeshRecord]) -> PartModel:
    """Build the model that the case requests and append its meshes to `meshes`; InputError for an unsuitable model."""
    choice = model_choice_of(case, part, high_hz)
    simplifications.log_all(choice.left_out, log)
    return built(case, choice, log, meshes)


def built(case: Case, choice: ModelChoice, log: Log, meshes: list[MeshRecord], parted: bool = False) -> PartModel:
    """Build the model of a given choice; parted: reduced cells have the stiffness of each material."""
    design, part = case.design, choice.part
    if choice.reduction:
        return _assembled(case, choice, log, parted)
    if choice.edge_m:
        from geometry.tet import scenes

        with log.step(f"mesh the {part} with tetrahedra"):
            mesh = scenes.tet_part(design, part, choice.edge_m, choice.quarter)
    else:
        assert choice.hexahedra
        mesh = hex_mesh(part_boxes(design, part, choice.hexahedra, choice.quarter), choice.hexahedra.order)
    meshes.append(mesh_record(part, mesh))
    warn_of_locking(design, mesh, log)
    clamped = ("foot",) if choice.edge_m and part == "pillar" else clamped_faces(part, choice.quarter)
    materials = region_materials(design.stack, design.pillar)
    layers = design.stack if part == "plate" else None
    lines, cuts = design.touch_lines_m, design.touch_cuts_m if part == "plate" else ()
    return SolidModel(mesh, materials, clamped, choice.quarter, lines, cuts_m=cuts, layers=layers)


def warn_of_locking(design: Design, mesh: AnyMesh, log: Log) -> None:
    """Warn of displacement elements that are too stiff; `antinode report extremes` has the measurement."""
    stiffest = max(material.average.poisson for material in region_materials(design.stack, design.pillar).values())
    if "tet" in mesh.kind and mesh.order == 2 and stiffest > LOCKING:
        log.warning(
            "LOCKING",
            f"Poisson's ratio {stiffest:g}: quadratic tetrahedra lock above {LOCKING:g}; use hexahedra of order 4",
        )
    if mesh.order == 1:
        log.warning("ORDER_1", "elements of order 1 are far too stiff in bending: use them for comparison only")


CLAMPED = {"zone": ("y+",), "pillar": ("touch",), "plate": ()}  # faces of boxes, of a quarter


def clamped_faces(part: str, quarter: bool) -> tuple[str, ...]:
    """Clamped faces of a part meshed by boxes: of a whole zone both long sides."""
    return ("y-", "y+") if part == "zone" and not quarter else CLAMPED[part]


def mesh_error_source(case: Case, choice: ModelChoice, model: PartModel) -> MeshErrorSource | None:
    """Estimator of the discretisation error of a part meshed whole; None for a reduced part, whose cells estimate it.

    It uses two coarser meshes, two lower orders if the part has no singular edges, or the stress recovery of tetrahedra.
    """
    fine, design = choice.hexahedra, case.design
    materials = region_materials(design.stack, design.pillar)
    if not isinstance(model, SolidModel):
        return None
    layers_of_plate = model.layers
    if choice.edge_m or fine is None:
        thin = choice.part == "plate" and design.outline is not None
        return StressRecovery(model.mesh, materials, model.scale, bool(CLAMPED[choice.part]), thin)
    boxes, layers = part_boxes(design, choice.part, fine, choice.quarter), fine.layers

    def nested(settings: HexSettings) -> Nested[SolidModel]:
        own = part_boxes(design, choice.part, settings, choice.quarter)
        held = clamped_faces(choice.part, choice.quarter)
        other = SolidModel(hex_mesh(own, settings.order), materials, held, choice.quarter, layers=layers_of_plate)
        return Nested(other, interpolation(own, boxes, fine.order, settings.order))

    order = nested(replace(fine, order=fine.order - 1))
    if choice.part == "plate" and design.pillar is None:
        return _lower_orders(design, boxes, order, nested(replace(fine, order=fine.order - 2)), fine.order)
    return CoarserMeshes(nested(fine.coarser) if layers else None, order, _shares(design, choice.part, fine))


def _lower_orders(
    design: Design, boxes: Boxes, order: Nested[SolidModel], lower: Nested[SolidModel], degree: int
) -> LowerOrders:
    """Error estimate from lower orders, for a plate without pillars and hence without singular edges."""
    smallest = min(*design.plate_m, design.thickness_m)
    x, y, z = (float(np.diff(line).max()) / smallest for line in (boxes.x, boxes.y, boxes.z))
    return LowerOrders(order, lower, degree, max(x, y), z)


def _shares(design: Design, part: str, mesh: HexSettings) -> ErrorFractions:
    """Error fractions of the singular edges of a part."""
    pillar = design.pillar
    if part == "plate":
        return foot_shares(design, mesh)
    if part == "pillar" and pillar:
        return clamped_shares(pillar.material, mesh, *pillar.joints, width_m=pillar.base_m)
    return clamped_shares(design.stack.mean, mesh, thickness_m=design.thickness_m)


def foot_shares(design: Design, mesh: HexSettings) -> ErrorFractions:
    """Error fractions of the rims of a plate's feet; a plate without pillars has no singular edges."""
    pillar = design.pillar
    return (
        rim_shares(design.stack.back, pillar.material, mesh, *pillar.joints, step_m=pillar.step_m)
        if pillar
        else ErrorFractions(order=mesh.order)
    )


def _assembled(case: Case, choice: ModelChoice, log: Log, parted: bool) -> PlateModel:
    assert choice.reduction
    design = case.design
    zone = predesign(design).zone if has_dampers(design.supports) else None
    for line in dents(design, zone.frequency_hz) if zone else ():
        log.warning("DENT", line)
    reductions = Reductions(
        design.stack,
        design.pillar,
        choice.reduction,
        CellCache(),
        *panel_mesher(design, choice, log),
        lossy=case.is_lossy,
        parted=parted,
        matrices=MatrixCache(),
        stressed=design.is_stressed,
    )
    with log.step("reduce cells"):
        model = PlateModel(design, reductions, resource_estimate.of_panels(design, choice, choice.reduction))
    log.info(
        f"{len(model.tiling.x) - 1} x {len(model.tiling.y) - 1} panels, {len(model.cells)} distinct: "
        f"{reductions.fresh} reduced, {reductions.reused} loaded from the cache"
    )
    if any(is_held_disc(each) for each in design.supports):
        with log.step("stiffness of the held discs"):
            model.assembled(model.symmetries[0])  # the classes of one numbering share it
    if design.is_stressed:
        load_with_stress(case, model, log)
    return model


def panel_mesher(design: Design, choice: ModelChoice, log: Log) -> tuple[Callable[[Panel], Mesh] | None, str]:
    """Function that meshes panels with a pillar into tetrahedra, and its name in the cache; (None, "") for boxes."""
    if choice.edge_m is None:
        return None, ""
    from geometry.tet import scenes

    edge = choice.edge_m

    def mesh(panel: Panel) -> Mesh:
        with log.step("mesh a panel with tetrahedra"):
            return scenes.tet_panel(design, panel, edge)

    file = design.pillar.file if design.pillar else None
    return mesh, f"tet {edge!r} {store.file_hash(Path(file)) if file else ''}"


def tet_cell(design: Design, edge_m: float, log: Log) -> tuple[Mesh, tuple[int, ...]]:
    """Mesh the unit cell, finer towards the pillar's foot; returns it with the axes in which it is halved."""
    from geometry.tet import scenes

    is_mirrored = {"x", "y"} <= {*design.cell_mirrors}
    with log.step("mesh the cell with tetrahedra"):
        return scenes.tet_cell(design, edge_m, "xy" if is_mirrored else ""), (0, 1) if is_mirrored else ()


ORDER, OFF = 2, 0.125  # coarse elements without graded layers: largest relative overestimate of a frequency
QUIET = TerminalLog(True)


@dataclass(frozen=True)
class CoarseModes:
    """Highest of the modes nearest to a frequency, Hz, and the number to request from each symmetry class."""

    highest_hz: float
    counts: dict[str | None, int]


def coarse_modes(case: Case, query: Request, choice: ModelChoice) -> CoarseModes | None:
    """Solve the modes of a request on a coarse mesh; None for a band, a reduced part, tetrahedra, or if the solve fails.

    All classes use quadratic elements. The class of the highest mode is solved again with elements for its frequency but
    without layers, which overestimates it by about two per cent, or more if classes change places.
    """
    near, count, fine = query.near_hz, query.count, choice.hexahedra
    if query.band_hz or near is None or count is None or choice.model != SOLID or choice.part == "plate":
        return None
    if fine is None or choice.edge_m is not None or fine.order <= ORDER:
        return None
    rough = _built(case, choice, ORDER)
    try:
        tones = {
            one: modes_near(rough.pencil(one), near, count).frequency_hz
            for one in ((query.symmetry,) if query.symmetry else rough.symmetries)
        }
        away = sorted(abs(tone - near) for each in tones.values() for tone in each)
        reach = away[min(count, len(away)) - 1]
        inside = {one: int((abs(each - near) <= reach).sum()) for one, each in tones.items()}
        last = max(inside, key=lambda one: float(tones[one][abs(tones[one] - near) <= reach].max(initial=0.0)))
        there = model_choice_of(case, query.part, near + reach)
        better = modes_near(_built(case, there, fine.order).pencil(last), near, inside[last]).frequency_hz
    except (CountMismatch, SolverError):
        return None
    return CoarseModes(
        float(better.max()), {one: _needed_count(each, near, reach, count) for one, each in tones.items()}
    )


def _needed_count(tones: FloatArray, near_hz: float, reach_hz: float, count: int) -> int:
    """Number of modes to request from a class.

    For the lowest modes it is one more than may lie within reach. Around a frequency it is the full count, because the
    coarse mesh does not show on which side a mode lies.
    """
    return count if near_hz else min(count, int((tones <= (1.0 + OFF) * reach_hz).sum()) + 1)


def _built(case: Case, choice: ModelChoice, order: int) -> PartModel:
    assert choice.hexahedra
    coarse = replace(choice.hexahedra, order=order, layers=0, skipped=0)
    return built(case, replace(choice, hexahedra=coarse, mesh_level=None), QUIET, [])
