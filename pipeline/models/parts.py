"""Plate, zone and lone pillar as models to solve, of boxes or of tetrahedra, with what is said of their meshes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings, Panel, hex_mesh, pillar_boxes, plate_boxes, zone_boxes
from geometry.layout import Design
from geometry.mesh import Mesh, check_mesh
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.cell_cache import CellCache
from pipeline.planning import simplifications
from pipeline.planning.mesh_rules import tet_cell_edge_m, tet_edge_m, tet_plate_edge_m
from pipeline.planning.model_choice import TET, ModelChoice, model_choice_of
from pipeline.records import fingerprint
from solvers.fem.eigen import SymmetricPencil
from solvers.fem.solid import SolidModel
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField
from solvers.superelement.build import PlateModel, Reductions, ReductionSettings

LOCKING = 0.45  # Poisson's ratio


class PartModel(Protocol):
    """A body whose modes are solved symmetry class by symmetry class."""

    name: str
    symmetries: tuple[str | None, ...]

    def pencil(self, symmetry: str | None) -> SymmetricPencil:
        """K and M of a class."""
        ...

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        ...

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy."""
        ...

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
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
    choice = model_choice_of(case, part, high_hz)
    simplifications.log_all(choice.left_out, log)
    return built(case, choice, log, meshes)


def built(case: Case, choice: ModelChoice, log: Log, meshes: list[dict[str, Any]]) -> PartModel:
    """The model of a way that is decided already."""
    return {"plate": _plate, "zone": _zone, "pillar": _pillar}[choice.part](case, choice, log, meshes)


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
        log.warning(
            "LOCKING", f"nu = {stiffest:g}: quadratic tetrahedra lock above {LOCKING:g}; hexahedra of order 4 do not"
        )
    if mesh.order == 1:
        log.warning("ORDER_1", "elements of order 1 are far too stiff in bending: kept for comparison only")


def _hex(boxes: Any, settings: HexSettings) -> Mesh:
    return hex_mesh(boxes, settings.order)


def _zone(case: Case, choice: ModelChoice, log: Log, meshes: list[dict[str, Any]]) -> SolidModel:
    if choice.kind == TET:
        mesh = tet_zone(case.design, case.solve.accuracy, log)
    else:
        assert choice.hexahedra
        mesh = _hex(zone_boxes(case.design, choice.hexahedra), choice.hexahedra)
    return _solid(case, "zone", mesh, ("y+",), choice.mirrored, meshes, log)


def _pillar(case: Case, choice: ModelChoice, log: Log, meshes: list[dict[str, Any]]) -> SolidModel:
    assert case.design.pillar
    if choice.kind == TET:
        return _solid(
            case, "pillar", tet_pillar(case.design, case.solve.accuracy, log), ("foot",), choice.mirrored, meshes, log
        )
    assert choice.hexahedra
    mesh = _hex(pillar_boxes(case.design.pillar, choice.hexahedra), choice.hexahedra)
    return _solid(case, "pillar", mesh, ("touch",), choice.mirrored, meshes, log)


def _plate(case: Case, choice: ModelChoice, log: Log, meshes: list[dict[str, Any]]) -> PartModel:
    design, accuracy = case.design, case.solve.accuracy
    if choice.reduction:
        mesher = None
        if choice.kind == TET:
            mesher = panel_mesher(design, accuracy, log)
        return _joined(design, accuracy, choice.reduction, log, mesher)
    if choice.kind == TET:
        mesh, mirrored = tet_plate(design, accuracy, log)
        assert mirrored == choice.mirrored
    else:
        assert choice.hexahedra
        mesh = _hex(plate_boxes(design, choice.hexahedra), choice.hexahedra)
    return _solid(case, "plate", mesh, (), choice.mirrored, meshes, log)


def _joined(
    design: Design,
    accuracy: float,
    reduction: ReductionSettings,
    log: Log,
    mesher: Callable[[Panel], Mesh] | None = None,
) -> PlateModel:
    file = design.pillar.file if design.pillar else None
    name = f"tet {accuracy!r} {fingerprint.file_hash(Path(file)) if file else ''}" if mesher else ""
    reductions = Reductions(design.thickness_m, design.material, design.pillar, reduction, CellCache(), mesher, name)
    with log.step("reduce cells"):
        model = PlateModel(design, reductions)
    log.info(
        f"{len(model.tiling.x) - 1} x {len(model.tiling.y) - 1} panels of {len(model.cells)} kinds: "
        f"{reductions.fresh} reduced now, {reductions.reused} taken from the cache"
    )
    return model


def tet_zone(design: Design, accuracy: float, log: Log) -> Mesh:
    """The quarter x, y >= 0 of the bare strip, finer towards its clamped side faces."""
    from geometry.tet import scenes

    with log.step("mesh the zone by tetrahedra"):
        return scenes.tet_zone(design, tet_edge_m(2.0 * design.thickness_m, accuracy), "xy")


def tet_pillar(design: Design, accuracy: float, log: Log) -> Mesh:
    """The whole lone pillar, finer towards its clamped foot."""
    from geometry.tet import scenes

    assert design.pillar
    with log.step("mesh the pillar by tetrahedra"):
        return scenes.tet_pillar(design.pillar, tet_edge_m(design.pillar.tip_m, accuracy))


def tet_plate(design: Design, accuracy: float, log: Log) -> tuple[Mesh, bool]:
    """The plate, and whether it is the quarter."""
    from geometry.tet import scenes

    quarter = design.is_mirrored
    edge = tet_plate_edge_m(design, accuracy)
    with log.step("mesh the plate by tetrahedra"):
        return scenes.tet_plate(design, edge, quarter), quarter


def tet_cell(design: Design, accuracy: float, log: Log) -> tuple[Mesh, tuple[int, ...]]:
    """The unit cell, finer towards the pillar's foot, and the axes along which it is halved."""
    from geometry.cad import solids
    from geometry.tet import scenes
    from geometry.tet.mesher import TetOptions, tet_mesh

    edge = tet_cell_edge_m(design, accuracy)
    quarter = design.pillar is None or design.pillar.is_own_image
    with log.step("mesh the cell by tetrahedra"):
        if not quarter:
            return scenes.tet_cell(design, edge, quarter_then_mirror=False), ()
        rim = scenes.foot_rim(design.pillar, design.thickness_m) if design.pillar else []
        return tet_mesh(solids.cell_solid(design, "xy"), edge, options=scenes.graded(TetOptions(), rim, edge)), (
            0,
            1,
        )


def panel_mesher(design: Design, accuracy: float, log: Log) -> Callable[[Panel], Mesh]:
    """What meshes the panels of a assembled plate that carry a pillar."""
    from geometry.tet import scenes

    edge = tet_cell_edge_m(design, accuracy)

    def mesh(panel: Panel) -> Mesh:
        with log.step("mesh a panel by tetrahedra"):
            return scenes.tet_panel(design, panel, edge)

    return mesh
