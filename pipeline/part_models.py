"""From a case to a solvable model of one part: the bare zone, the lone pillar, or the plate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from geometry.elements import FloatArray
from geometry.hexmesh import HexSettings, Piece, hex_mesh, pillar_boxes, plate_boxes, zone_boxes
from geometry.layout import Design
from geometry.mesh import Mesh, check_mesh
from pipeline import planner
from pipeline.case import Case
from pipeline.cell_shelf import CellShelf
from pipeline.errors import InputFault
from pipeline.logs import Log
from solvers.confinement import TouchField
from solvers.fem.eigen import SymmetricPencil
from solvers.fem.solid import SolidModel
from solvers.fem.surface import Skin
from solvers.superelement.build import PlateModel, Reductions

LOCKING = 0.45  # Poisson's ratio


class PartModel(Protocol):
    """A body whose modes are solved mirror class by mirror class."""

    name: str
    parities: tuple[str | None, ...]

    def pencil(self, parity: str | None) -> SymmetricPencil:
        """K and M of a class."""
        ...

    def touch(self, parity: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        ...

    def pillar_share(self, parity: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy."""
        ...

    def skin(self, parity: str | None, vectors: FloatArray) -> Skin:
        """Outer surface."""
        ...


def mesh_record(what: str, mesh: Mesh, volume_m3: float | None = None) -> dict[str, Any]:
    """Check a mesh and describe it for the record. Raises MeshError when it is not sound."""
    report = check_mesh(mesh, volume_m3)
    return {
        "what": what,
        "kind": mesh.kind,
        "order": mesh.order,
        "cells": report.cells,
        "nodes": report.nodes,
        "dof": mesh.dof,
        "sha256": mesh.sha256,
        "worst_jacobian_ratio": report.worst_jacobian_ratio,
        "volume_error": report.volume_m3 / volume_m3 - 1.0 if volume_m3 else None,
    }


def build(case: Case, part: str, high_hz: float, log: Log, meshes: list[dict[str, Any]]) -> PartModel:
    """The model that the case asks for; its meshes are appended to `meshes`. InputFault for one that cannot serve."""
    check_model(case, box=part == "zone" or not (case.design.pillar and not case.design.pillar.is_box))
    if part == "plate":
        return _plate(case, high_hz, log, meshes)
    return _zone(case, log, meshes) if part == "zone" else _pillar(case, log, meshes)


def check_model(case: Case, box: bool) -> None:
    """Refuse what no solver here does: an analytic answer to a computed question, hexahedra for what is no box."""
    faults = []
    if case.solve.model == "analytic":
        faults.append(
            "solve.model = 'analytic': must be auto, superelement or solid here; `antinode predesign` is analytic"
        )
    if case.solve.mesh == "hex" and not box:
        faults.append("solve.mesh = 'hex': must be auto or tet, only square pillars without fillet are boxes")
    if faults:
        raise InputFault(f"{case.source or case.name}: {fault}" for fault in faults)


def _solid(
    case: Case, what: str, mesh: Mesh, clamped: tuple[str, ...], mirrored: bool, meshes: list[dict[str, Any]], log: Log
) -> SolidModel:
    meshes.append(mesh_record(what, mesh))
    warn_of_locking(case.design, mesh, log)
    pillar = case.design.pillar
    materials = {
        "plate": case.design.material,
        "pillar": pillar.material if pillar else case.design.material,
        "body": case.design.material,
    }
    return SolidModel(mesh, materials, clamped, mirrored)


def warn_of_locking(design: Design, mesh: Mesh, log: Log) -> None:
    """Say where displacement elements are known to be too stiff (`antinode report extremes` has the measurement)."""
    stiffest = max(design.material.poisson, design.pillar.material.poisson if design.pillar else -1.0)
    if mesh.kind == "tet" and mesh.order == 2 and stiffest > LOCKING:
        log.alarm(
            "LOCKING", f"nu = {stiffest:g}: quadratic tetrahedra lock above {LOCKING:g}; hexahedra of order 4 do not"
        )
    if mesh.order == 1:
        log.alarm("ORDER_1", "elements of order 1 are far too stiff in bending: kept for comparison only")


def _hex(boxes: Any, settings: HexSettings) -> Mesh:
    return hex_mesh(boxes, settings.order)


def _zone(case: Case, log: Log, meshes: list[dict[str, Any]]) -> SolidModel:
    design, accuracy = case.design, case.solve.accuracy
    if case.solve.mesh == "tet":
        from pipeline.tet_parts import tet_zone

        return _solid(case, "zone", tet_zone(design, accuracy, log), ("y+",), True, meshes, log)
    settings = planner.zone_settings(design, accuracy)
    log.left_out("CAD and tetrahedra", "the zone is a box")
    mesh = _hex(zone_boxes(design, settings), settings)
    return _solid(case, "zone", mesh, ("y+",), True, meshes, log)


def _pillar(case: Case, log: Log, meshes: list[dict[str, Any]]) -> SolidModel:
    design, accuracy = case.design, case.solve.accuracy
    assert design.pillar
    if case.solve.mesh == "tet" or not design.pillar.is_box:
        from pipeline.tet_parts import tet_pillar

        return _solid(case, "pillar", tet_pillar(design, accuracy, log), ("foot",), False, meshes, log)
    settings = planner.pillar_settings(design, accuracy)
    log.left_out("CAD and tetrahedra", "the pillar is a box")
    return _solid(case, "pillar", _hex(pillar_boxes(design.pillar, settings), settings), ("touch",), True, meshes, log)


def _plate(case: Case, high_hz: float, log: Log, meshes: list[dict[str, Any]]) -> PartModel:
    design, solve = case.design, case.solve
    if not design.rows:
        log.left_out("pillars", "the plate has no rows")
    tetrahedral = solve.mesh == "tet" or design.needs_cad
    if tetrahedral:
        from pipeline import tet_parts

        joinable = design.is_mirrored
        if solve.model == "solid" or not joinable:
            return _tet_plate(case, joinable, log, meshes)
        mesher = tet_parts.piece_mesher(design, solve.accuracy, log)
        return _joined(design, solve.accuracy, high_hz, log, mesher)
    log.left_out("CAD and tetrahedra", "the scene is made of boxes")
    if solve.model == "solid":
        settings = planner.solid_plate_settings(design, solve.accuracy)
        return _solid(case, "plate", _hex(plate_boxes(design, settings), settings), (), True, meshes, log)
    return _joined(design, solve.accuracy, high_hz, log)


def _tet_plate(case: Case, joinable: bool, log: Log, meshes: list[dict[str, Any]]) -> SolidModel:
    """The whole plate as one body of tetrahedra."""
    if case.solve.model == "superelement":
        raise InputFault(
            f"{case.name}: solve.model = 'superelement': must be auto or solid, a pillar from CAD need not be its own "
            "mirror image and its plate is solved whole"
        )
    if not joinable:
        log.left_out("joined cells", "a pillar from CAD need not be its own mirror image")
    from pipeline.tet_parts import tet_plate

    mesh, mirrored = tet_plate(case.design, case.solve.accuracy, log)
    return _solid(case, "plate", mesh, (), mirrored, meshes, log)


def _joined(
    design: Design, accuracy: float, high_hz: float, log: Log, mesher: Callable[[Piece], Mesh] | None = None
) -> PlateModel:
    recipe = planner.plate_recipe(design, accuracy, high_hz)
    name = f"tet {accuracy!r}" if mesher else ""
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, CellShelf(), mesher, name)
    with log.step("reduce cells"):
        model = PlateModel(design, reductions)
    log.info(
        f"{len(model.tiling.x) - 1} x {len(model.tiling.y) - 1} pieces of {len(model.cells)} kinds: "
        f"{reductions.fresh} reduced now, {reductions.reused} taken from the shelf"
    )
    return model
